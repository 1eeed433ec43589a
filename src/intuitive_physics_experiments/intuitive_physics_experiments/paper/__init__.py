"""The paper's synthetic set and its experiments."""
