"""How a sensor without a known pose has moved since its environment was modelled."""
