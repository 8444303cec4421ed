"""The functions that open and describe the instrument.

Names, prototypes and buffer sizes: HHLib 3.0 header. Codes without an open instrument: the vendor's library,
observed.
"""

from typing import TYPE_CHECKING, Any

from simulators.wire.hydraharp.codes import BASE_RESOLUTION_PS, BINNING_STEPS, Code, Mode, Slot, error_string
from simulators.wire.hydraharp.exports import DOUBLE_OUT, INT, INT_OUT, TEXT_OUT, Exports, require, write_text

if TYPE_CHECKING:
    from simulators.wire.hydraharp.simulator import HydraHarpSimulator as Simulator

EXPORTS = Exports()
_declare = EXPORTS.declare

#: DLL, TTTR and MARKERS.
FEATURES = 0x01 | 0x02 | 0x04
INPUTS_PER_MODULE = 2


@_declare("HH_GetLibraryVersion", TEXT_OUT)
def get_library_version(simulator: "Simulator", vers: Any) -> None:
    """Tell the version that is simulated."""
    write_text(vers, "3.0")


@_declare("HH_GetErrorString", TEXT_OUT, INT)
def get_error_string(simulator: "Simulator", errstring: Any, errcode: int) -> None:
    """Tell the name of a code; unknown codes are no error."""
    write_text(errstring, error_string(errcode))


@_declare("HH_OpenDevice", INT, TEXT_OUT)
def open_device(simulator: "Simulator", devidx: int, serial: Any) -> None:
    """Open index 0; opening it twice is answered as busy, which is unconfirmed."""
    require(0 <= devidx < len(simulator.slots))
    was = simulator.slots[devidx]
    require(was is not Slot.OPEN, Code.DEVICE_BUSY)
    simulator.slots[devidx] = Slot.CLOSED
    require(devidx == 0 and simulator.connected, Code.DEVICE_OPEN_FAIL)
    require(not simulator.busy, Code.DEVICE_BUSY)
    simulator.slots[devidx] = Slot.OPEN
    simulator.instrument.initialized = False
    write_text(serial, simulator.serial)


@_declare("HH_CloseDevice", INT)
def close_device(simulator: "Simulator", devidx: int) -> None:
    """Close; never an error for a valid index. A running measurement ends."""
    require(0 <= devidx < len(simulator.slots))
    if simulator.slots[devidx] is Slot.OPEN:
        simulator.instrument.running = False
        simulator.slots[devidx] = Slot.CLOSED


@_declare("HH_Initialize", INT, INT, INT)
def initialize(simulator: "Simulator", devidx: int, mode: int, refsource: int) -> None:
    """Set the mode, reset all settings; that this is refused while measuring is unconfirmed."""
    require(mode in tuple(Mode))
    instrument = simulator.opened(devidx)
    require(not instrument.running, Code.INSTANCE_RUNNING)
    require(refsource in (0, 1))
    instrument.initialize(Mode(mode), external_reference=refsource == 1)


@_declare("HH_GetHardwareInfo", INT, TEXT_OUT, TEXT_OUT, TEXT_OUT)
def get_hardware_info(simulator: "Simulator", devidx: int, model: Any, partno: Any, version: Any) -> None:
    """Tell a model, and by part number and version that it is none of PicoQuant's."""
    simulator.initialized(devidx)
    write_text(model, "HydraHarp 400")
    write_text(partno, "SIM")
    write_text(version, "SIM")


@_declare("HH_GetSerialNumber", INT, TEXT_OUT)
def get_serial_number(simulator: "Simulator", devidx: int, serial: Any) -> None:
    """Tell the serial number."""
    simulator.initialized(devidx)
    write_text(serial, simulator.serial)


@_declare("HH_GetFeatures", INT, INT_OUT)
def get_features(simulator: "Simulator", devidx: int, features: Any) -> None:
    """Tell what it is able to do."""
    simulator.initialized(devidx)
    features[0] = FEATURES


@_declare("HH_GetBaseResolution", INT, DOUBLE_OUT, INT_OUT)
def get_base_resolution(simulator: "Simulator", devidx: int, resolution: Any, binsteps: Any) -> None:
    """Tell the finest bin width and the number of binning codes."""
    simulator.initialized(devidx)
    resolution[0] = BASE_RESOLUTION_PS
    binsteps[0] = BINNING_STEPS


@_declare("HH_GetHardwareDebugInfo", INT, TEXT_OUT)
def get_hardware_debug_info(simulator: "Simulator", devidx: int, debuginfo: Any) -> None:
    """Tell that there is nothing to tell."""
    simulator.initialized(devidx)
    write_text(debuginfo, "simulated instrument, no system error")


@_declare("HH_GetNumOfInputChannels", INT, INT_OUT)
def get_num_of_input_channels(simulator: "Simulator", devidx: int, nchannels: Any) -> None:
    """Tell the number of inputs."""
    nchannels[0] = simulator.initialized(devidx).inputs


@_declare("HH_GetNumOfModules", INT, INT_OUT)
def get_num_of_modules(simulator: "Simulator", devidx: int, nummod: Any) -> None:
    """Tell the number of modules: a main module, and one for each two inputs."""
    nummod[0] = _modules(simulator.initialized(devidx).inputs)


@_declare("HH_GetModuleInfo", INT, INT, INT_OUT, INT_OUT)
def get_module_info(
    simulator: "Simulator", devidx: int, modidx: int, modelcode: Any, versioncode: Any
) -> None:
    """Tell a module's codes: zero, since the real ones are unconfirmed."""
    instrument = simulator.initialized(devidx)
    require(0 <= modidx < _modules(instrument.inputs))
    modelcode[0] = 0
    versioncode[0] = 0


@_declare("HH_GetModuleIndex", INT, INT, INT_OUT)
def get_module_index(simulator: "Simulator", devidx: int, channel: int, modidx: Any) -> None:
    """Tell the module that an input belongs to."""
    instrument = simulator.initialized(devidx)
    require(0 <= channel < instrument.inputs)
    modidx[0] = 1 + channel // INPUTS_PER_MODULE


def _modules(inputs: int) -> int:
    return 1 + -(-inputs // INPUTS_PER_MODULE)
