"""The subcommands of `intuitive-physics`, a file each."""
