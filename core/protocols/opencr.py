"""Control table of the TurtleBot3's OpenCR board (ROS 2 firmware), a Dynamixel device with id 200.

The board answers ping, read and write only; a register that a request covers in part reads as zeros.
"""

from math import pi

from knotwork.core.protocols.registers import Register

DEVICE = 200
MODEL_NUMBER = 0x5000
BAUD = 1_000_000  # of no effect on USB; never 1200, which starts the boot loader
HEARTBEAT_TIMEOUT = 0.5  # s without a changed heartbeat until the firmware stops the wheels
CALIBRATION_TIME = 5.0  # s that an IMU recalibration may block the board

BURGER, WAFFLE, WAFFLE_MANIPULATOR = 1, 2, 3  # model_information

VELOCITY_UNIT = 0.229 * 2.0 * pi / 60.0  # rad/s
TICKS = 4096  # a turn
COMMAND_UNIT = 0.01  # m/s and rad/s
ACCELERATION_UNIT = 214.577 * 2.0 * pi / 3600.0  # rad/s^2
VOLTAGE_UNIT = 0.01  # V
PERCENT_UNIT = 0.01  # %
CORRUPT = b"\xfd\xfd\xfd\xfd"  # old firmware repeats FD after an FF FF FD in a read, under a valid CRC

MODEL = Register(0, "H")
MODEL_INFORMATION = Register(2, "I")
FIRMWARE = Register(6, "B")
ID = Register(7, "B")
PROTOCOL = Register(9, "B")
MILLIS = Register(10, "I")
MICROS = Register(14, "I")  # firmware 4
DEBUG_MODE = Register(14, "B")  # firmware 5: 1 switches the heartbeat check off; never write it
CONNECT_ROS2 = Register(15, "B")  # firmware 5: 1 while the heartbeat lives
CONNECT_MANIPULATOR = Register(16, "B")
DEVICE_STATUS = Register(18, "b")  # 0 running, -1 no wheel motors at boot
HEARTBEAT = Register(19, "B")
LEDS = tuple(Register(20 + i, "B") for i in range(4))
BUTTONS = (Register(26, "B"), Register(27, "B"))
BUMPERS = (Register(28, "B"), Register(29, "B"))
ILLUMINATION = Register(30, "H")
INFRARED = Register(34, "I")
SONAR = Register(38, "f")
BATTERY_VOLTAGE = Register(42, "I")
BATTERY_PERCENTAGE = Register(46, "I")
SOUND = Register(50, "B")
IMU_RECALIBRATION = Register(59, "B")
ANGULAR_VELOCITY = tuple(Register(60 + 4 * i, "f") for i in range(3))  # x y z, rad/s
LINEAR_ACCELERATION = tuple(Register(72 + 4 * i, "f") for i in range(3))  # m/s^2
MAGNETIC = tuple(Register(84 + 4 * i, "f") for i in range(3))  # T
ORIENTATION = tuple(Register(96 + 4 * i, "f") for i in range(4))  # w x y z
PRESENT_CURRENT = (Register(120, "i"), Register(124, "i"))  # left, right
PRESENT_VELOCITY = (Register(128, "i"), Register(132, "i"))
PRESENT_POSITION = (Register(136, "i"), Register(140, "i"))
MOTOR_CONNECT = Register(148, "B")  # firmware 5
TORQUE_ENABLE = Register(149, "B")
COMMAND_LINEAR = tuple(Register(150 + 4 * i, "i") for i in range(3))  # x y z, only x is used
COMMAND_ANGULAR = tuple(Register(162 + 4 * i, "i") for i in range(3))  # only z is used
PROFILE_ACCELERATION = (Register(174, "I"), Register(178, "I"))
