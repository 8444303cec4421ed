"""The 44 functions of HHLib 3.0 with their exact C prototypes (source: the vendor's hhlib.h).

All return int. Text is ``POINTER(c_char)`` rather than ``c_char_p``, because the library writes into it.
"""

from ctypes import POINTER, c_char, c_double, c_int, c_uint, c_void_p
from typing import Any

_TEXT = POINTER(c_char)
_INT_OUT = POINTER(c_int)
_UINT_OUT = POINTER(c_uint)
_DOUBLE_OUT = POINTER(c_double)

#: Name of each function and the types of its arguments.
PROTOTYPES: dict[str, tuple[Any, ...]] = {
    "HH_GetLibraryVersion": (_TEXT,),
    "HH_GetErrorString": (_TEXT, c_int),
    "HH_OpenDevice": (c_int, _TEXT),
    "HH_CloseDevice": (c_int,),
    "HH_Initialize": (c_int, c_int, c_int),
    "HH_GetHardwareInfo": (c_int, _TEXT, _TEXT, _TEXT),
    "HH_GetSerialNumber": (c_int, _TEXT),
    "HH_GetFeatures": (c_int, _INT_OUT),
    "HH_GetBaseResolution": (c_int, _DOUBLE_OUT, _INT_OUT),
    "HH_GetHardwareDebugInfo": (c_int, _TEXT),
    "HH_GetNumOfInputChannels": (c_int, _INT_OUT),
    "HH_GetNumOfModules": (c_int, _INT_OUT),
    "HH_GetModuleInfo": (c_int, c_int, _INT_OUT, _INT_OUT),
    "HH_GetModuleIndex": (c_int, c_int, _INT_OUT),
    "HH_Calibrate": (c_int,),
    "HH_SetSyncDiv": (c_int, c_int),
    "HH_SetSyncCFD": (c_int, c_int, c_int),
    "HH_SetSyncChannelOffset": (c_int, c_int),
    "HH_SetInputCFD": (c_int, c_int, c_int, c_int),
    "HH_SetInputChannelOffset": (c_int, c_int, c_int),
    "HH_SetInputChannelEnable": (c_int, c_int, c_int),
    "HH_SetStopOverflow": (c_int, c_int, c_uint),
    "HH_SetBinning": (c_int, c_int),
    "HH_SetOffset": (c_int, c_int),
    "HH_SetHistoLen": (c_int, c_int, _INT_OUT),
    "HH_SetMeasControl": (c_int, c_int, c_int, c_int),
    "HH_ClearHistMem": (c_int,),
    "HH_StartMeas": (c_int, c_int),
    "HH_StopMeas": (c_int,),
    "HH_CTCStatus": (c_int, _INT_OUT),
    "HH_GetHistogram": (c_int, _UINT_OUT, c_int, c_int),
    "HH_GetResolution": (c_int, _DOUBLE_OUT),
    "HH_GetSyncPeriod": (c_int, _DOUBLE_OUT),
    "HH_GetSyncRate": (c_int, _INT_OUT),
    "HH_GetCountRate": (c_int, c_int, _INT_OUT),
    "HH_GetFlags": (c_int, _INT_OUT),
    "HH_GetElapsedMeasTime": (c_int, _DOUBLE_OUT),
    "HH_GetWarnings": (c_int, _INT_OUT),
    "HH_GetWarningsText": (c_int, _TEXT, c_int),
    "HH_SetMarkerHoldoffTime": (c_int, c_int),
    "HH_SetMarkerEdges": (c_int, c_int, c_int, c_int, c_int),
    "HH_SetMarkerEnable": (c_int, c_int, c_int, c_int, c_int),
    "HH_ReadFiFo": (c_int, _UINT_OUT, c_int, _INT_OUT),
    "HH_GetContModeBlock": (c_int, c_void_p, _INT_OUT),
}
