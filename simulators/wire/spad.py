"""The firmware of an ID120, which biases the bench's detector, without a gate.

Source: a published driver. UNCONFIRMED, and so choices made here: the texts of ``*IDN?``, ``INFO:`` and
``REG:STATE?``, that a range is answered as ``low,high,step``, that the dead time is in nanoseconds, and that
an unknown command is not answered.
"""

import re
from collections.abc import Callable

from simulators.bench import Bench
from simulators.wire.lines import LineFirmware

#: Settings in their own units: lowest, highest, step, and the value after power-on.
RANGES = {
    "THRESHOLD:VOLTAGE": (0, 1_047_000, 500, 100_000),  # uV
    "DEADTIME:TIME": (40, 1_000_000, 40, 40),  # ns
    "BIAS:VOLTAGE": (0, 250_000_000, 80_000, 155_040_000),  # uV
    "COUNTERS:INTEGRATION_TIME": (200, 100_000, 200, 1_000),  # ms
    "REG:TEMP_SET_POINT": (-50_000, -10_000, 1_000, -40_000),  # milli-degrees C
}

#: Under which name the range of a setting is asked for.
CAPABILITIES = {
    "THRESHOLD:CAPABILITY": "THRESHOLD:VOLTAGE",
    "DEADTIME:CAPABILITY": "DEADTIME:TIME",
    "BIAS:CAPABILITY": "BIAS:VOLTAGE",
    "COUNTERS:INTEGRATION_TIME_CAPABILITY": "COUNTERS:INTEGRATION_TIME",
    "REG:TEMP_SET_POINT_CAPABILITY": "REG:TEMP_SET_POINT",
}

#: Words that a setting takes, and the one after power-on.
WORDS = {
    "OUTPUT1:POLARITY": (("POSITIVE", "NEGATIVE"), "POSITIVE"),
    "OUTPUT2:POLARITY": (("POSITIVE", "NEGATIVE"), "POSITIVE"),
    "REG:RUN": (("TRUE", "FALSE"), "FALSE"),
}


class SpadInstrument:
    """The detector as messages in and messages out.

    Parameters
    ----------
    bench
        Its detector is biased, its clock is followed.
    serial_number
        The USB serial number.

    Attributes
    ----------
    vendor_id, product_id, manufacturer, product, serial_number
        For the USB descriptors.
    output
        What has been answered and not yet read.
    bias_error
        Set by whoever breaks the bias supply.
    drop_answers
        So many of the next answers are lost.
    """

    vendor_id = 0x1DDC
    product_id = 0x0330
    manufacturer = "ID Quantique"
    product = "ID120 simulated"

    def __init__(self, bench: Bench, *, serial_number: str = "SIM0001") -> None:
        self.serial_number = serial_number
        self.clock = bench.clock
        self.output = bytearray()
        self.bias_error = False
        self.drop_answers = 0
        self._bench = bench
        self._numbers = {name: start for name, (_, _, _, start) in RANGES.items()}
        self._words = {name: start for name, (_, start) in WORDS.items()}
        self._measured: dict[str, Callable[[], str]] = {
            "*IDN": lambda: f"{self.manufacturer},{self.product},{self.serial_number},1.0",
            "INFO:PRODUCT_NAME": lambda: self.product,
            "INFO:PRODUCT_SERIAL_NUMBER": lambda: self.serial_number,
            "INFO:PRODUCT_TYPE": lambda: "SPAD",
            "INFO:APD_TYPE": lambda: "Si",
            "INFO:FIRMWARE_VERSION": lambda: "1.0",
            "INFO:OUTPUT1_STANDARD": lambda: "NIM",
            "INFO:BIAS_BREAKDOWN_VOLTAGE": lambda: "150000000",
            "BIAS:ERROR_STATUS": lambda: "TRUE" if self.bias_error else "FALSE",
            "COUNTERS:DETECTION_FREQ": lambda: f"{self._count_rate_hz():.0f}",
            "REG:MEASURED_TEMP": lambda: str(self._numbers["REG:TEMP_SET_POINT"]),
            "REG:STATE": lambda: "RUNNING" if self._bench.light.biased else "OFF",
        }
        self._act()

    def receive(self, data: bytes) -> None:
        """Take one message, which may hold several lines; unknown lines are not answered."""
        for line in data.decode("ascii", "replace").splitlines():
            command = line.strip().upper()
            if command.endswith("?"):
                answer = self._tell(command[:-1])
                if answer is not None and not self._dropped():
                    self.output += answer.encode("ascii") + b"\n"
            else:
                self._set(*command.partition(" ")[::2])

    def _dropped(self) -> bool:
        dropped = self.drop_answers > 0
        self.drop_answers -= dropped
        return dropped

    def _tell(self, name: str) -> str | None:
        if name in self._measured:
            return self._measured[name]()
        if name in CAPABILITIES:
            return "{},{},{}".format(*RANGES[CAPABILITIES[name]][:3])
        if name in self._numbers:
            return str(self._numbers[name])
        return self._words.get(name)

    def _set(self, name: str, value: str) -> None:
        """Change a setting; a value outside its range changes nothing."""
        value = value.strip()
        if name in WORDS and value in WORDS[name][0]:
            self._words[name] = value
        elif name in RANGES and re.fullmatch(r"[-+]?[0-9]{1,12}", value):
            low, high, step, _ = RANGES[name]
            if low <= int(value) <= high:
                self._numbers[name] = low + (int(value) - low) // step * step
        self._act()

    def _act(self) -> None:
        """Bring the bench to the state of the settings."""
        numbers, light = self._numbers, self._bench.light
        wanted: dict[str, bool | float] = {
            "biased": self._words["REG:RUN"] == "TRUE" and not self.bias_error,
            "gated": False,
            "hold_off_s": numbers["DEADTIME:TIME"] / 1e9,
        }
        changed = {name: value for name, value in wanted.items() if getattr(light, name) != value}
        if changed:
            self._bench.change_light(**changed)

    def _count_rate_hz(self) -> float:
        """Return what all channels together count."""
        return sum(self._bench.count_rate_hz(number) for number in range(len(self._bench.photons)))


#: A detector on USB, or one on a serial line.
DetectorInstrument = SpadInstrument | LineFirmware
