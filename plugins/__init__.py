"""The plugins that ship with Knotwork; each registers as a third party's would, from this table."""

BUILTINS = (
    "knotwork.plugins.drivers.carmen",
    "knotwork.plugins.drivers.gazebo_text",
    "knotwork.plugins.drivers.lds01",
    "knotwork.plugins.drivers.minesrover",
    "knotwork.plugins.drivers.opencr",
    "knotwork.plugins.drivers.sim2d",
    "knotwork.plugins.maps.spline_surface",
    "knotwork.plugins.localizers.gauss_newton",
    "knotwork.plugins.observers.ekf",
    "knotwork.plugins.policies.follow_path",
    "knotwork.plugins.policies.teleop_keyboard",
    "knotwork.plugins.sinks.map_export",
    "knotwork.plugins.sinks.map_image",
    "knotwork.plugins.sinks.mcap",
    "knotwork.plugins.sinks.summary",
    "knotwork.plugins.sinks.trajectory",
    "knotwork.plugins.commands.demo",
    "knotwork.plugins.commands.emulate",
    "knotwork.plugins.commands.evaluate",
    "knotwork.plugins.commands.log",
)
