"""What goes wrong with a device, without being anyone's mistake."""


class DeviceLost(Exception):
    """The device is gone; the driver reconnects."""


class NoAnswer(DeviceLost):
    """Several attempts, no answer; once may be noise on the line."""
