"""The size and order of the source tree in nine numbers; `make house` prints them."""
