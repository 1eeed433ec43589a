"""Tools of the repository: set-up, pinned requirements, measures of the source tree."""
