"""Perception on rendered bags, against the truth and beside other libraries."""
