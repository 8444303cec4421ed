"""How much memory a slab takes, way by way as `recon.solvers.rsd.dispatch` goes."""

from math import pi
from os import cpu_count

from recon.aperture import LatticeAxis, recognise
from recon.capture import C_M_PER_S
from recon.grid import VoxelGrid
from recon.sampling import Slab
from recon.solvers.problem import Need, Task
from recon.solvers.rsd import dispatch, regular, tabulated
from recon.solvers.rsd.lattice import plan_axis, taps_half_width

#: What computing one weight of a position's spreading takes for a moment, in double precision.
TAP_BYTES = 64
#: Positions whose tables are made at once at the least; fewer would be slow.
LEAST_TABLES = 256


def any_geometry(task: Task, part: Slab) -> Need:
    """Return what `recon.solvers.rsd.dispatch.focus` needs for a slab, whichever way it takes."""
    capture, grid, many = task.capture, task.grid, len(part.band)
    still = task.frames == 1
    planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[part.planes])
    slab = 24 * planes.size if still else 0
    runs = dispatch.planar_runs(capture)
    legs = runs[0].legs if runs else 1
    if dispatch.regular(capture, runs):
        return regular_grid(task, part)
    if dispatch.quicker_on_lattice(runs, capture.laser_m, part.band, planes, task.frames):
        # The lattice over all positions is as large as that of any run.
        x, y = dispatch.lattice(capture.laser_m, legs, part.band, planes)
        threads, wall = _lattice(x, y, planes, legs, part)
        taps = 2 * taps_half_width(x.pitch_m * legs * part.band.last_rad_per_s / C_M_PER_S / pi)
        spreading = (TAP_BYTES * taps + 8) * capture.positions
        least = 8 * x.count * y.count + 8 * capture.positions
        if still:
            return Need(slab + threads + spreading, wall + least, 1)
        return Need(threads + spreading, min(many * wall, regular.WALL_BYTES) + many * least, many)
    if not still:  # term by term, from a copy of the spectra
        return Need(100 * capture.positions, 8 * capture.positions * many, many)
    nodes = tabulated.node_range(capture, part.band, planes, task.camera)[2]
    # The table's phases, with their double-precision halves, belong to the pass's frequencies.
    fixed = slab + 40 * nodes * many + 100 * capture.positions
    return Need(fixed, 2 * tabulated.NODE_BYTES * nodes * LEAST_TABLES, many)


def regular_grid(task: Task, part: Slab) -> Need:
    """Return what is needed for a slab where all positions are one regular grid."""
    grid, many, still = task.grid, len(part.band), task.frames == 1
    planes = VoxelGrid(grid.x_m, grid.y_m, grid.z_m[part.planes])
    (run,) = dispatch.planar_runs(task.capture)
    aperture = recognise(task.capture.laser_m - [0, 0, run.depth_m])
    threads, wall = _lattice(aperture.x, aperture.y, planes, run.legs, part)
    slab = 24 * planes.size if still else 0
    return Need(slab + threads, wall if still else min(many * wall, regular.WALL_BYTES), 1 if still else many)


def _lattice(x: LatticeAxis, y: LatticeAxis, grid: VoxelGrid, legs: int, part: Slab) -> tuple[int, int]:
    """Return the bytes of all threads' planes, and of one frequency's wall spectrum."""
    wavenumber = legs * part.band.last_rad_per_s / C_M_PER_S
    along_x, along_y = plan_axis(x, grid.x_m, wavenumber), plan_axis(y, grid.y_m, wavenumber)
    points = along_y.length * along_x.length
    quarter = (along_y.half + 1) * (along_x.half + 1)
    thread = 24 * quarter + 8 * along_y.folded * along_x.folded + 8 * len(grid.y_m) * along_x.folded
    thread += 48 * len(grid.y_m) * len(grid.x_m)
    # One wall field is put on its lattice at a time, in two steps where it is spread.
    return (cpu_count() or 1) * thread + 16 * points, 8 * points
