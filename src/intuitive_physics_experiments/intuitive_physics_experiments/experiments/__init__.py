"""The paper's experiments, a file each; `intuitive-physics experiment` runs them."""
