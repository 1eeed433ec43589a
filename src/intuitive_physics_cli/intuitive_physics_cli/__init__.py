"""The command line `intuitive-physics` and its reports."""
