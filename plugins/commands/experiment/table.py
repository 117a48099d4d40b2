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
}
