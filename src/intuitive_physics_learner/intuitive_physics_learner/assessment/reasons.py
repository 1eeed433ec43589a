"""Why an observation is doubtful, in the words of reports."""

from enum import Enum


class Reason(Enum):
    """What is wrong with an observation; laws of motion give all but the last two."""

    MISTRACKED = "mistracked"
    NOT_FREE = "not in free flight"
    HELD = "held"
    UNEXPLAINED = "unexplained by any undisturbed motion"
    CONTRADICTORY = "in contradiction to what is known of its materials"

    def at(self, seconds: float) -> str:
        """Return the reason with its time, s after the start of the observation."""
        return f"{self.value} at t = {seconds:.2f} s"
