"""The layouts of scan and volume files, each as one table.

The writers take the descriptions from here, the readers check files against it, and the pages under ``docs``
show it. An attribute's path is that of its object, ``@`` and its name; ``/devices/*`` stands for any name.
"""

from dataclasses import dataclass

#: Types of entries, and how the documentation calls them.
TYPES = {
    "group": "group",
    "text": "text",
    "json": "text (JSON)",
    "document": "text (JSON)",
    "flag": "true or false",
    "whole": "whole number",
    "number": "number",
    "counts": "unsigned integer, or float where `kind` is `expectation`",
    "unsigned": "unsigned integer",
    "float": "floating point",
    "integer": "whole number",
    "texts": "text",
    "bool": "true or false",
    "table": "table of utc, first, last, kind, sentence",
}


@dataclass(frozen=True)
class Entry:
    """What one path of a file holds.

    Attributes
    ----------
    type
        A key of `TYPES`.
    what
        Description with unit; written into the file beside the data.
    shape
        Sizes, or their names, which must agree over the whole file; ``"1|steps"`` allows either, and
        ``"steps*channels+1"`` is the number of pairs and one.
    required
        Whether a file without it is refused. This program writes the rest too.
    """

    type: str
    what: str
    shape: tuple[int | str, ...] = ()
    required: bool = False

    @property
    def kind(self) -> str:
        """Type and shape in words, e.g. ``floating point (positions, 3)``."""
        sizes = ", ".join(str(size).replace("|", " or ") for size in self.shape)
        comma = "," if len(self.shape) == 1 else ""
        return TYPES[self.type] + (f" ({sizes}{comma})" if self.shape else "")


Layout = dict[str, Entry]

_ROOT: Layout = {
    "/@version": Entry("whole", "version of the layout", required=True),
    "/@software": Entry("text", "program and version that wrote the file"),
    "/@created": Entry("text", "when the file was created, UTC, ISO 8601"),
}

SCAN: Layout = {
    "/@format": Entry("text", "`rig-scan`", required=True),
    **_ROOT,
    "/start": Entry("group", "the request, written before the first photon"),
    "/start@plan": Entry("json", "the scan plan: its passes, of which steps are made"),
    "/start@configuration": Entry(
        "json",
        "the configuration, absolute paths as names; with the calibrations below it is the rig's state",
    ),
    "/start@doubts": Entry("json", "list of doubts about the calibrations, as plain sentences"),
    "/start@simulated": Entry("flag", "whether the photons were computed rather than measured"),
    "/start@command": Entry("text", "the command that made the file"),
    "/start@resumed": Entry("json", "list of the times (UTC) at which an interrupted scan was resumed"),
    "/start@imported": Entry(
        "json",
        "file, sha256, layout of the file of another layout that was imported, what was assumed, and where "
        "its places were moved: moved.origin_m and moved.axes, this frame's origin and axes (rows) "
        "in that one; estimated: values that it lacked and that were estimated from its data, with quantity, "
        "value, low, high [s or m], how, and all of it in words",
    ),
    "/notes": Entry("group", "notes of people on the scan; they do not change the measurement"),
    "/notes@operator": Entry("text", "who measured"),
    "/notes@sample": Entry("text", "what was measured: the hidden object, the wall"),
    "/notes@purpose": Entry("text", "what the scan is for"),
    "/notes@note": Entry("text", "other notes"),
    "/devices": Entry("group", "one group for each device, as read back before the scan"),
    "/devices/*": Entry("group", "settings of one device as attributes, read back from it"),
    "/devices/*@identity": Entry(
        "text", "maker, model, serial number and firmware as the device reports them"
    ),
    "/geometry": Entry(
        "group",
        "positions [m]; right-handed frame: origin at the wall's centre, y up, z out of the wall, "
        "x to the right for one who faces the wall",
        required=True,
    ),
    "/geometry/laser_m": Entry(
        "float", "laser spot of each step on the wall [m]", ("steps", 3), required=True
    ),
    "/geometry/detector_m": Entry(
        "float",
        "spot that each channel sees [m]: one for all steps, or one for each",
        ("1|steps", "channels", 3),
        required=True,
    ),
    "/geometry/delay_s": Entry(
        "float",
        "measured delay of each step and channel [s], to be subtracted for rectified time; where time_origin "
        "is laser, it replaces the three attributes below and /channels/delay_s",
        ("steps", "channels"),
    ),
    "/geometry@laser_head_m": Entry(
        "number",
        "where the light leaves the laser head [m]; required if time_origin is laser and delay_s is missing",
        (3,),
    ),
    "/geometry@detector_head_m": Entry(
        "number",
        "where the light enters the detector [m]; required if time_origin is laser and delay_s is missing",
        (3,),
    ),
    "/geometry@electronics_delay_s": Entry(
        "number",
        "delay of cables and electronics [s]; required if time_origin is laser and delay_s is missing",
    ),
    "/geometry/mirror_rad": Entry(
        "float",
        "commanded optical angles of the steering mirror, right and up [rad], "
        "from which a later calibration can compute the spots again",
        ("steps", 2),
    ),
    "/channels": Entry("group", "the detector's pixels, one entry of each dataset for each of them"),
    "/channels/name": Entry("texts", "name of the channel", ("channels",)),
    "/channels/input": Entry("integer", "its input of the timing instrument, counted from 0", ("channels",)),
    "/channels/delay_s": Entry(
        "float",
        "extra delay of its pulses, added to that of the attributes of /geometry [s]; subtracted for "
        "rectified time where time_origin is laser",
        ("channels",),
    ),
    "/channels/response_s": Entry(
        "float", "full width at half maximum of its response to a pulse [s]", ("channels",)
    ),
    "/channels/dark_hz": Entry(
        "float", "its dark counts a second [Hz]; NaN if they were never measured", ("channels",)
    ),
    "/passes": Entry(
        "group",
        "for each pass of the plan except the first, the settings that were read back before it, "
        "as under /devices",
    ),
    "/calibration": Entry("group", "the calibrations that the scan used, one dataset for each kind"),
    "/calibration/*": Entry("document", "the calibration as it was stored, with its own digest", ()),
    "/calibration_data": Entry("group", "arrays of calibrations that are too large for text"),
    "/calibration_data/*": Entry(
        "float", "one field of a calibration, named KIND.FIELD; its digest is in the text", ("any",)
    ),
    "/transients": Entry("group", "photons of each step and channel over time", required=True),
    "/transients@bin_width_s": Entry("number", "width of a bin [s]", required=True),
    "/transients@first_bin_s": Entry("number", "left edge of bin 0 [s]", required=True),
    "/transients@time_origin": Entry(
        "text",
        "what t = 0 is: `wall`, the pulse is on the wall and a time is that of the path wall, object, "
        "wall; or `laser`, the pulse leaves the laser head, and the times contain the paths from laser "
        "to wall and from wall to detector",
        required=True,
    ),
    "/transients@bins": Entry(
        "whole", "number of bins; without it, the time-tagged form ends with its last photon"
    ),
    "/transients@fade_from_s": Entry(
        "number",
        "rectified time [s] before which the record holds the wall's own light, to be faded in after",
    ),
    "/transients@gate_start_s": Entry("number", "when the detector's gate opens [s], in the file's time"),
    "/transients@gate_stop_s": Entry("number", "when the detector's gate closes [s], in the file's time"),
    "/transients@instrument_response_s": Entry(
        "number", "full width at half maximum of the instrument response [s]"
    ),
    "/transients/counts": Entry("counts", "photons in each bin", ("steps", "channels", "bins")),
    "/transients/counts@kind": Entry(
        "text", "`photons`, counted; or `expectation`, a rendered or processed signal in arbitrary units"
    ),
    "/transients/photons": Entry(
        "unsigned",
        "time-tagged form: bin index of every photon, step by step, and in a step channel by channel",
        ("photons",),
    ),
    "/transients/photon_offset": Entry(
        "unsigned",
        "time-tagged form: first photon of each step and channel, then the total; "
        "without meaning at steps that are not measured",
        ("steps*channels+1",),
    ),
    "/transients/done": Entry("bool", "whether the step has been measured", ("steps",)),
    "/transients/live_time_s": Entry(
        "float",
        "measurement time of the step as reported by the instrument [s]; NaN where unknown",
        ("steps",),
    ),
    "/transients/checksum": Entry(
        "unsigned",
        "CRC-32 of each chunk of counts, or of photons, as it is stored; "
        "a chunk with another CRC-32 was changed later, and its steps count as not measured",
        ("chunks",),
    ),
    "/transients/step_checksum": Entry(
        "unsigned",
        "time-tagged form: CRC-32 of the step's entries of photon_offset, from that of its first channel to "
        "that of the next step's, 8 bytes each, little endian; where it differs, the step counts as not "
        "measured",
        ("steps",),
    ),
    "/events": Entry(
        "table",
        "what happened during the scan: when (UTC, ISO 8601), the first and the last step that it concerns, "
        "its kind (`warning`, `light` or `by hand`), and a sentence",
        ("events",),
    ),
    "/unfinished": Entry(
        "group",
        "exposures that ended early because of a stop, numbered from 0: (channels, bins) counts, "
        "with attributes `step` "
        "and `live_time_s`. They are not part of `/transients`: rig resume measures the step again",
    ),
    "/stop": Entry("group", "how the run ended; a file without it was interrupted"),
    "/stop@status": Entry("text", "`complete`, `interrupted` or `failed`"),
    "/stop@reason": Entry("text", "the reason why it ended, in words"),
    "/stop@stopped": Entry("text", "when it ended, UTC, ISO 8601"),
    "/stop@photons": Entry("number", "sum of all counts"),
    "/stop@warnings": Entry(
        "json", "list of warnings, as plain sentences; /events has the steps that they concern"
    ),
}

#: What is otherwise in a scan file of version 1: one channel, which has no axis, and positions for steps.
SCAN_1: Layout = {
    **{
        path: entry
        for path, entry in SCAN.items()
        if not path.startswith(("/channels", "/passes", "/calibration_data"))
    },
    "/geometry/detector_m": Entry(
        "float",
        "spot that the detector sees [m]: one for all, or one for each position",
        ("1|steps", 3),
        required=True,
    ),
    "/geometry/delay_s": Entry(
        "float",
        "measured delay of each position [s], to be subtracted for rectified time; where time_origin is "
        "laser, it replaces the three attributes below",
        ("steps",),
    ),
    "/transients/counts": Entry("counts", "photons in each bin", ("steps", "bins")),
    "/transients/photon_offset": Entry(
        "unsigned", "time-tagged form: first photon of each position, then the total", ("steps+1",)
    ),
}

#: The layouts of scan files that can be read, by version.
SCANS: dict[int, Layout] = {1: SCAN_1, 2: SCAN}
SCAN_VERSION = 2
VOLUME_VERSION = 1

VOLUME: Layout = {
    "/@format": Entry("text", "`rig-volume`", required=True),
    **_ROOT,
    "/@parameters": Entry("json", "parameters of the reconstruction"),
    "/@command": Entry("text", "the command that made it"),
    "/@scan": Entry("text", "name of the scan file it came from"),
    "/@scan_digest": Entry("text", "SHA-256 of the scan file it came from"),
    "/volume": Entry("group", "the image", required=True),
    "/volume/intensity": Entry(
        "float",
        "intensity, the field's squared magnitude: (z, y, x); for the transient camera "
        "(t, z, y, x) or (t, y, x)",
        ("...", "y", "x"),
        required=True,
    ),
    "/volume/x_m": Entry("float", "voxel centres along x [m]", ("x",), required=True),
    "/volume/y_m": Entry("float", "voxel centres along y [m]", ("y",), required=True),
    "/volume/z_m": Entry("float", "voxel centres along z [m], the depth", ("z",), required=True),
    "/volume/t_s": Entry("float", "times of frames [s], after the flash or since the scan began", ("t",)),
    "/volume/depth_m": Entry(
        "float", "depth of the surface seen at each pixel [m]; NaN where nothing", ("y", "x")
    ),
    "/volume/confidence": Entry(
        "float",
        "probability that noise alone stays below the brightest value at each pixel, 0 to 1",
        ("y", "x"),
    ),
}


def as_markdown(layout: Layout) -> str:
    """Return the table of a layout as the documentation shows it."""
    rows = [
        f"| `{path}` | {entry.kind} | {'yes' if entry.required else ''} | {entry.what} |"
        for path, entry in layout.items()
    ]
    return "\n".join(["| path | type (shape) | required | what |", "| --- | --- | --- | --- |", *rows])
