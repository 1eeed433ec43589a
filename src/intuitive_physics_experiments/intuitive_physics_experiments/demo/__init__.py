"""The demo: thrown balls are perceived, learned from and predicted, by real nodes over DDS."""
