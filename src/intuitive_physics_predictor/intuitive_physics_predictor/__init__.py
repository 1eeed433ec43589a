"""Noisy-Newton prediction: distributions of where objects will be, and questions about them."""
