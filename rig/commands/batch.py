"""``rig batch``: many images, from a file that lists scans and settings."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rig.commands.options import AsJson, Cluster

if TYPE_CHECKING:
    from rig.cluster.batch import Outcome
    from rig.cluster.jobs import Job


def batch(
    jobs: Annotated[
        Path,
        typer.Argument(metavar="JOBS.toml", help="The file with scans and settings, see docs/cluster.md."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="The results. [dim]\\[default: JOBS, beside the file][/dim]"
        ),
    ] = None,
    cluster: Cluster = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List the images and which of them exist; compute nothing.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="Also compute images that take more than ten minutes.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Image many scans, each with all combinations of the settings listed.

    A batch that was stopped goes on when it is started again: images of the same scan, settings and version
    are kept. One that fails is reported, and the others go on; the exit code is then that of the first.

    [bold]Examples[/bold]

      rig batch jobs.toml                        here, one after the other

      rig batch jobs.toml --cluster local:4      on four workers of this computer
    """
    from rig.cluster.jobs import read_jobs
    from rig.commands import console

    listed = read_jobs(jobs, however_long=yes)
    folder = out or jobs.with_suffix("")
    outcomes: list[Outcome] = []
    if dry_run:
        outcomes = _planned(listed, folder)
    else:
        try:
            with console.Working(f"{len(listed)} images") as working:
                for outcome in _outcomes(listed, folder, cluster):
                    outcomes.append(outcome)
                    working(len(outcomes) / len(listed))
                    if outcome.status == "failed":
                        console.warn(f"{outcome.name}: {outcome.found['error']}")
        except KeyboardInterrupt:
            console.say(
                f"{len(outcomes)} of {len(listed)} images are done; run the same command again to continue."
            )
            raise
    _show(outcomes, folder, as_json)
    failed = [one for one in outcomes if one.status == "failed"]
    if failed:
        raise typer.Exit(failed[0].found["exit_code"])


def _outcomes(jobs: "list[Job]", folder: Path, cluster: str | None) -> "Any":
    from rig.cluster.batch import run
    from rig.cluster.joined import joined, local_workers
    from rig.files.inspection import inspect_all

    if cluster is None:
        yield from run(jobs, folder)
        return
    local_workers(cluster)
    # copies of this process do it in milliseconds, as long as no thread of dask runs
    inspect_all(sorted({job.scan for job in jobs}))
    with joined(cluster) as client:
        yield from run(jobs, folder, client, ("rig", *sys.argv[1:]))


def _planned(jobs: "list[Job]", folder: Path) -> "list[Outcome]":
    from rig.cluster.batch import Outcome, Record

    record = Record(folder)
    return [record.kept(job) or Outcome(job.name, "to do") for job in jobs]


def _show(outcomes: "list[Outcome]", folder: Path, as_json: bool) -> None:
    from rig.commands import console
    from rig.model.quantities import show_length

    if as_json:
        images = [
            {"name": one.name, "status": one.status, "took_s": round(one.took_s, 2), **one.found}
            for one in outcomes
        ]
        console.print_json({"folder": str(folder), "images": images})
        return
    rows = []
    for one in outcomes:
        length_m, voxels = one.found.get("wavelength_m"), one.found.get("voxels")
        rows.append(
            (
                one.name,
                one.status,
                "" if length_m is None else show_length(length_m),
                "" if voxels is None else " x ".join(map(str, voxels)),
                {True: "yes", False: "none", None: ""}[one.found.get("signal")],
                f"{one.took_s:.1f} s" if one.took_s else "",
            )
        )
    console.print_table(("image", "status", "wavelength", "voxels", "signal", "took"), rows, ("status",))
    counts = {status: sum(one.status == status for one in outcomes) for status in ("done", "kept", "failed")}
    console.say(f"{folder}: " + ", ".join(f"{count} {status}" for status, count in counts.items() if count))
