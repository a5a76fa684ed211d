"""A plant with all families, as a file."""

CELL = """\
name = "cell"

[buses.main]
port = "/dev/ttyUSB0"
baudrate = 115200

[axes.x]
bus = "main"
family = "mks"
address = 1
units_per_turn = 8.0
unit = "mm"
limits = [-20.0, 120.0]
watchdog = 1.0
mode = "SR_VFOC"

[axes.y]
family = "tlr"
address = 2
limits = [-5, 5]

[axes.left]
family = "zlac"
address = 3
side = "left"
watchdog = 1.0

[axes.right]
family = "zlac"
address = 3
side = "right"
reverse = true

[groups.xy]
axes = ["x", "y"]

[vehicle]
wheel_radius = 0.085
track = 0.4
"""
