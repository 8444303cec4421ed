"""Sections of which there are several kinds: which one a table in a file is."""

from typing import Any

from pydantic import GetCoreSchemaHandler, ValidationError, ValidationInfo, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError, core_schema

from rig.errors import ConfigError
from rig.model.config.delayers import (
    DelayerConfig,
    Dg645Config,
    ExternalDelayerConfig,
    PsdConfig,
    T560Config,
)
from rig.model.config.detectors import DetectorConfig, ExternalDetectorConfig, Id120Config, MpdConfig
from rig.model.config.galvos import AnalogueGalvoConfig, GalvoConfig, OptotuneConfig
from rig.model.config.harps import (
    HydraHarp500Config,
    HydraHarpConfig,
    MultiHarpConfig,
    PicoHarp330Config,
    TimeHarp260Config,
)
from rig.model.config.installed import InstalledKind, installed, names
from rig.model.config.lasers import ExternalLaserConfig, Katana08Config, KatanaConfig, LaserConfig, NktConfig
from rig.model.config.point_clocks import DaqClockConfig, PointClockConfig
from rig.model.config.section import DeviceSection
from rig.model.config.shutters import DaqShutterConfig, SerialShutterConfig, ShutterConfig
from rig.model.config.timing import PlaybackConfig, TcspcConfig
from rig.model.problems import in_words
from rig.model.quantities import FROM_RECORD


def kind_named(section: type[DeviceSection]) -> str:
    """Return what a section of this type is called in a file."""
    return str(section.model_fields["kind"].default)


class ByKind:
    """Marks a field whose section is of one of several kinds; installed packages may bring more.

    Parameters
    ----------
    role
        The field's name.
    base
        What all kinds are derived from.
    *kinds
        The program's own; the first is meant where a table does not say.

    Attributes
    ----------
    kinds
        The program's own, by their names.
    """

    def __init__(self, role: str, base: type[DeviceSection], *kinds: type[DeviceSection]) -> None:
        self._role = role
        self._base = base
        self.kinds = {kind_named(section): section for section in kinds}
        self.usual = kinds[0]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Choose the section by its kind, and write each as what it is."""
        own = core_schema.tagged_union_schema(
            {kind: handler.generate_schema(section) for kind, section in self.kinds.items()},
            discriminator=self.kind_of,
        )
        return core_schema.with_info_wrap_validator_function(
            self._choose,
            own,
            serialization=core_schema.wrap_serializer_function_ser_schema(
                lambda section, write: write(section), schema=core_schema.any_schema()
            ),
        )

    def kind_of(self, table: Any) -> str:
        """Return the kind that a table says; one that does not say is of the usual kind."""
        usual = kind_named(self.usual)
        return str(table.get("kind", usual) if isinstance(table, dict) else getattr(table, "kind", usual))

    def installed(self, kind: str) -> InstalledKind | None:
        """Return a kind that an installed package brings; raises `ConfigError` if it cannot be loaded."""
        return installed(self._role, kind, self._base)

    def in_words(self) -> str:
        """Return all kinds, also those that installed packages bring, for people."""
        return ", ".join(f"'{kind}'" for kind in [*self.kinds, *names(self._role)])

    def _choose(self, table: Any, own: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if isinstance(table, self._base):
            return table
        kind = self.kind_of(table)
        if kind in self.kinds or not isinstance(table, dict):
            return own(table)
        try:
            found = self.installed(kind)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        if found is None:
            raise ValueError(f"there is no kind {kind}; choose among {self.in_words()}")
        from_record = info.context == FROM_RECORD
        try:
            return found.section.model_validate(
                table, context=info.context, by_alias=not from_record, by_name=from_record
            )
        except ValidationError as error:
            raise _in_words(error, kind, found.section) from None


def _in_words(error: ValidationError, kind: str, section: type[DeviceSection]) -> ValidationError:
    """Say what is wrong with a section whose keys only its package knows."""
    keys = ", ".join(field.alias or name for name, field in section.model_fields.items())

    def said(problem: Any) -> str:
        if problem["type"] == "extra_forbidden":
            return f"is not a key of kind '{kind}', which has {keys}"
        return in_words(problem)

    lines = [
        InitErrorDetails(
            type=PydanticCustomError("installed_kind", "{said}", {"said": said(problem)}),
            loc=problem["loc"],
            input=problem["input"],
        )
        for problem in error.errors()
    ]
    return ValidationError.from_exception_data(error.title, lines)


#: By role, which is the field's name too.
ROLES = {
    "galvo": ByKind("galvo", GalvoConfig, OptotuneConfig, AnalogueGalvoConfig),
    "laser": ByKind("laser", LaserConfig, KatanaConfig, Katana08Config, NktConfig, ExternalLaserConfig),
    "detector": ByKind("detector", DetectorConfig, MpdConfig, Id120Config, ExternalDetectorConfig),
    "delayer": ByKind("delayer", DelayerConfig, PsdConfig, Dg645Config, T560Config, ExternalDelayerConfig),
    "point_clock": ByKind("point_clock", PointClockConfig, DaqClockConfig),
    "shutter": ByKind("shutter", ShutterConfig, DaqShutterConfig, SerialShutterConfig),
    "tcspc": ByKind(
        "tcspc",
        TcspcConfig,
        HydraHarpConfig,
        MultiHarpConfig,
        PicoHarp330Config,
        TimeHarp260Config,
        HydraHarp500Config,
        PlaybackConfig,
    ),
}
