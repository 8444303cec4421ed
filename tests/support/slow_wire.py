"""A wire on which answers take their time."""


class Slow:
    """Firmware whose answers reach the computer only some time later."""

    def __init__(self, firmware, clock, delay_s):
        self.firmware, self.clock, self.delay_s = firmware, clock, delay_s
        self.arrived, self.on_the_way = bytearray(), []

    def receive(self, data):
        self.firmware.receive(data)
        self.on_the_way.append((self.clock.now_s() + self.delay_s, bytes(self.firmware.output)))
        self.firmware.output.clear()

    @property
    def output(self):
        while self.on_the_way and self.on_the_way[0][0] <= self.clock.now_s():
            self.arrived += self.on_the_way.pop(0)[1]
        return self.arrived
