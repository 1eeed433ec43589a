"""Messages to library objects and back, whatever library the message classes come from.

What builds a message takes a factory `make(type_name)(**fields)`, such as
`make("geometry_msgs/msg/Point")(x=0.0, y=0.0, z=1.0)`. It is given every field of the type; lists
of any length are of the type `array.array`, those of a fixed length NumPy arrays. What reads a
message uses nothing but its fields.
"""
