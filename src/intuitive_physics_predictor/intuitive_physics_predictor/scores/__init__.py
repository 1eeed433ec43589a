"""Proper scores, and noise that is fitted by them."""
