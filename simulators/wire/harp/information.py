"""The functions that open and describe the instrument.

Names, prototypes and buffer sizes: headers. Codes without an open instrument: the libraries, observed.
"""

from typing import Any

from simulators.wire.harp.codes import Code, Mode, Slot
from simulators.wire.harp.connection import Connection
from simulators.wire.harp.exports import (
    DOUBLE_OUT,
    INT,
    INT_OUT,
    TEXT_OUT,
    Exports,
    require,
    take,
    write_text,
)
from simulators.wire.harp.records import MOST_INPUTS

EXPORTS = Exports()
_declare = EXPORTS.declare

#: DLL, TTTR and MARKERS.
FEATURES = 0x01 | 0x02 | 0x04
INPUTS_PER_MODULE = 2


@_declare("GetLibraryVersion", TEXT_OUT)
def get_library_version(connection: Connection, vers: Any) -> None:
    """Tell the version that is simulated."""
    write_text(vers, connection.family.version)


@_declare("GetErrorString", TEXT_OUT, INT)
def get_error_string(connection: Connection, errstring: Any, errcode: int) -> None:
    """Tell the name of a code; unknown codes are no error."""
    write_text(errstring, connection.family.error_string(errcode))


@_declare("OpenDevice", INT, TEXT_OUT)
def open_device(connection: Connection, devidx: int, serial: Any) -> None:
    """Open an index that has an instrument; opening it twice is answered as busy, which is unconfirmed."""
    require(connection.slot(devidx) is not Slot.OPEN, Code.DEVICE_BUSY)
    connection.ever_asked = True
    require(devidx < len(connection.serials) and connection.connected, Code.DEVICE_OPEN_FAIL)
    require(not connection.busy, Code.DEVICE_BUSY)
    connection.slots[devidx] = Slot.OPEN
    connection.opened(devidx).initialized = False
    write_text(serial, connection.serials[devidx])


@_declare("CloseDevice", INT)
def close_device(connection: Connection, devidx: int) -> None:
    """Close; never an error for a valid index. A running measurement ends."""
    if connection.slot(devidx) is Slot.OPEN:
        if connection.connected:
            connection.opened(devidx).running = False
        connection.slots[devidx] = Slot.CLOSED


@_declare("Initialize", INT, INT, INT, where=lambda family: family.references is not None)
def initialize(connection: Connection, devidx: int, mode: int, refsource: int) -> None:
    """Set the mode, reset all settings; only the 10 MHz reference is simulated, and lost."""
    references = connection.family.references
    assert references is not None
    take(mode in connection.family.modes, 2)
    if connection.family.says_which_argument:
        take(refsource in references, 3)
    connection.opened(devidx)
    take(refsource in references, 3)
    _initialize(connection, devidx, mode, external=refsource != 0)


@_declare("Initialize", INT, INT, where=lambda family: family.references is None)
def initialize_without_reference(connection: Connection, devidx: int, mode: int) -> None:
    """Set the mode, reset all settings."""
    take(mode in connection.family.modes, 2)
    _initialize(connection, devidx, mode, external=False)


def _initialize(connection: Connection, devidx: int, mode: int, *, external: bool) -> None:
    """Begin anew; that this is refused while measuring is unconfirmed."""
    instrument = connection.opened(devidx)
    require(not instrument.running, Code.INSTANCE_RUNNING)
    require(mode != Mode.CONTINUOUS or connection.family.calibrates, Code.INVALID_MODE)
    require(mode != Mode.T3 or instrument.inputs <= MOST_INPUTS, Code.INVALID_MODE)
    instrument.initialize(Mode(mode), external_reference=external)


@_declare("GetHardwareInfo", INT, TEXT_OUT, TEXT_OUT, TEXT_OUT)
def get_hardware_info(connection: Connection, devidx: int, model: Any, partno: Any, version: Any) -> None:
    """Tell a model, and by part number and version that it is none of PicoQuant's."""
    connection.initialized(devidx)
    write_text(model, connection.family.model)
    write_text(partno, "SIM")
    write_text(version, "SIM")


@_declare("GetSerialNumber", INT, TEXT_OUT)
def get_serial_number(connection: Connection, devidx: int, serial: Any) -> None:
    """Tell the serial number."""
    connection.initialized(devidx)
    write_text(serial, connection.serials[devidx])


@_declare("GetFeatures", INT, INT_OUT)
def get_features(connection: Connection, devidx: int, features: Any) -> None:
    """Tell what it is able to do."""
    connection.initialized(devidx)
    features[0] = FEATURES


@_declare("GetBaseResolution", INT, DOUBLE_OUT, INT_OUT)
def get_base_resolution(connection: Connection, devidx: int, resolution: Any, binsteps: Any) -> None:
    """Tell the finest bin width and the number of binning codes."""
    connection.initialized(devidx)
    resolution[0] = connection.family.base_ps
    binsteps[0] = connection.family.binnings


@_declare("GetHardwareDebugInfo", INT, TEXT_OUT, where=lambda family: family.debug == "GetHardwareDebugInfo")
def get_hardware_debug_info(connection: Connection, devidx: int, debuginfo: Any) -> None:
    """Tell that there is nothing to tell."""
    connection.initialized(devidx)
    write_text(debuginfo, "simulated instrument, no system error")


@_declare("GetDebugInfo", INT, TEXT_OUT, where=lambda family: family.debug == "GetDebugInfo")
def get_debug_info(connection: Connection, devidx: int, debuginfo: Any) -> None:
    """Tell that there is nothing to tell, also where no instrument could be opened."""
    if connection.slot(devidx) is Slot.OPEN or not connection.ever_asked:
        connection.initialized(devidx)
    write_text(debuginfo, "simulated instrument, no system error")


@_declare("GetNumOfInputChannels", INT, INT_OUT)
def get_num_of_input_channels(connection: Connection, devidx: int, nchannels: Any) -> None:
    """Tell the number of inputs."""
    nchannels[0] = connection.initialized(devidx).inputs


@_declare("GetNumOfModules", INT, INT_OUT, where=lambda family: family.calibrates)
def get_num_of_modules(connection: Connection, devidx: int, nummod: Any) -> None:
    """Tell the number of modules: a main module, and one for each two inputs."""
    nummod[0] = _modules(connection.initialized(devidx).inputs)


@_declare("GetModuleInfo", INT, INT, INT_OUT, INT_OUT, where=lambda family: family.calibrates)
def get_module_info(
    connection: Connection, devidx: int, modidx: int, modelcode: Any, versioncode: Any
) -> None:
    """Tell a module's codes: zero, since the real ones are unconfirmed."""
    instrument = connection.initialized(devidx)
    take(0 <= modidx < _modules(instrument.inputs), 2)
    modelcode[0] = 0
    versioncode[0] = 0


@_declare("GetModuleIndex", INT, INT, INT_OUT, where=lambda family: family.calibrates)
def get_module_index(connection: Connection, devidx: int, channel: int, modidx: Any) -> None:
    """Tell the module that an input belongs to."""
    instrument = connection.initialized(devidx)
    take(0 <= channel < instrument.inputs, 2)
    modidx[0] = 1 + channel // INPUTS_PER_MODULE


def _modules(inputs: int) -> int:
    return 1 + -(-inputs // INPUTS_PER_MODULE)
