"""Control table of Dynamixel X motors as wheels: XL430-W250 (Burger) and XM430-W210 (Waffle)."""

from math import pi

from knotwork.core.protocols.registers import Register

XL430, XM430 = 1060, 1030  # model numbers
LEFT, RIGHT = 1, 2  # ids on a TurtleBot3

VELOCITY_UNIT = 0.229 * 2.0 * pi / 60.0  # rad/s
TICKS = 4096  # a turn
ACCELERATION_UNIT = 214.577 * 2.0 * pi / 3600.0  # rad/s^2
VOLTAGE_UNIT = 0.1  # V
WATCHDOG_UNIT = 0.02  # s
WATCHDOG_TRIPPED = -1  # reads as; goals are refused until 0 is written
VELOCITY_LIMITS = {XL430: 265, XM430: 330}
REVERSE = 0x01  # bit of the drive mode: the right wheel of a TurtleBot3
VELOCITY_MODE = 1
BAUD_CODES = {9600: 0, 57_600: 1, 115_200: 2, 1_000_000: 3, 2_000_000: 4, 3_000_000: 5, 4_000_000: 6}
HARDWARE_ERRORS = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "encoder",
    0x10: "electrical shock",
    0x20: "overload",
}

MODEL = Register(0, "H")
FIRMWARE = Register(6, "B")
ID = Register(7, "B")
BAUD_RATE = Register(8, "B")
RETURN_DELAY = Register(9, "B")  # 2 us
DRIVE_MODE = Register(10, "B")
OPERATING_MODE = Register(11, "B")
PWM_LIMIT = Register(36, "H")
CURRENT_LIMIT = Register(38, "H")  # XM430
VELOCITY_LIMIT = Register(44, "I")
SHUTDOWN = Register(63, "B")
TORQUE_ENABLE = Register(64, "B")  # EEPROM, addresses 0 to 63, is writable while this is 0
LED = Register(65, "B")
STATUS_RETURN_LEVEL = Register(68, "B")
HARDWARE_ERROR = Register(70, "B")
BUS_WATCHDOG = Register(98, "b")
GOAL_VELOCITY = Register(104, "i")
PROFILE_ACCELERATION = Register(108, "I")
MOVING = Register(122, "B")
PRESENT_LOAD = Register(126, "h")  # XL430: 0.1 %; XM430: current, 2.69 mA
PRESENT_VELOCITY = Register(128, "i")
PRESENT_POSITION = Register(132, "i")
PRESENT_VOLTAGE = Register(144, "H")
PRESENT_TEMPERATURE = Register(146, "B")  # degrees C
