"""Which experiments exist: name to the class that does it, and one line. Others add theirs here."""

EXPERIMENTS: dict[str, tuple[str, str]] = {
    "curve-slam": (
        "knotwork.plugins.commands.experiment.curve_slam:CurveSlam",
        "section 6.5: B-spline curve SLAM along walls and in a turn on the spot, at three knot intervals and all three",
    ),
    "depth-gains": (
        "knotwork.plugins.commands.experiment.depth_gains:DepthGains",
        "Fig. 9.3: the depth observer at half, once and twice the critical gain",
    ),
    "depth-single": (
        "knotwork.plugins.commands.experiment.depth_single:DepthSingle",
        "Fig. 9.4 to 9.6: three controllers of one point, and a moving goal",
    ),
    "depth-multi": (
        "knotwork.plugins.commands.experiment.depth_multi:DepthMulti",
        "Fig. 9.7 to 9.9: visual servoing of 4 to 9 points with wrong depths, passive and active",
    ),
    "depth-robot": (
        "knotwork.plugins.commands.experiment.depth_robot:DepthRobot",
        "a wheeled base with a camera: depths by backing up, then the goal view",
    ),
    "square-room": (
        "knotwork.plugins.commands.experiment.square_room:SquareRoom",
        "Fig. 7.5 and 7.6: mapping error of each map against the side of a square room",
    ),
    "circular-room": (
        "knotwork.plugins.commands.experiment.circular_room:CircularRoom",
        "Fig. 7.7 and 7.8: mapping error of each map against the sensor's noise",
    ),
    "timing": (
        "knotwork.plugins.commands.experiment.map_timing:MapTiming",
        "Table 7.1: what a scan costs to map, each map at 5 cm",
    ),
    "corridor-memory": (
        "knotwork.plugins.commands.experiment.corridor_memory:CorridorMemory",
        "section 6.5: memory of each map of a corridor and of an apartment",
    ),
    "pillars": (
        "knotwork.plugins.commands.experiment.pillars:Pillars",
        "the pillars of turtlebot3_world, mapped from exact poses and found in the map",
    ),
}
