"""`casashell simulate` as the command line has it."""

from __future__ import annotations

from typing import Final

import typer

from casashell.app import options as opt
from casashell.app import simulate_options as sim
from casashell.app.failures import command

HELP: Final = (
    "Let time pass for a solved shell: gravity, wind, bodies in motion, contact with dry friction "
    "that holds.\n\n"
    "DIR is the folder of a result. Writes frames.npz, simulation.json, player.html, a picture of "
    "the end beside the start, and the formats asked for into SIMDIR.\n\n"
    "Exit codes: 0 complete, 1 a step failed (frames so far written), 2 bad input (nothing "
    "written), 130 interrupted (frames so far written)."
)


def simulate(
    folder: sim.Folder,
    seconds: sim.Seconds,
    fps: sim.Fps = 60.0,
    substeps: sim.Substeps = 1,
    rest: sim.Rest = "natural",
    damping: sim.DampingOption = None,
    obstacle_sequence: sim.Sequences = None,
    sequence_fps: sim.SequenceFps = None,
    keyframes: sim.Keyframes = None,
    wind: sim.WindOption = None,
    gusts: sim.Gusts = None,
    air: sim.Air = None,
    drag: sim.Drag = None,
    lift: sim.Lift = None,
    onset: sim.Onset = None,
    out: sim.Out = None,
    force: opt.Force = False,
    resume: sim.Resume = False,
    formats: sim.Formats = "html",
    no_pictures: sim.NoPictures = False,
    quiet: opt.Quiet = False,
    as_json: opt.Json = False,
    debug: opt.Debug = False,
) -> None:
    """The command; `HELP` is what it says about itself."""
    with command(debug):
        options = sim.SimulateOptions(
            folder,
            *(seconds, fps, substeps, rest, damping),
            tuple(obstacle_sequence or ()),
            sequence_fps,
            tuple(keyframes or ()),
            sim.AirOptions(wind, gusts, air, drag, lift, onset),
        )
        from casashell.app.simulate import SimulateOutput, run_simulate

        wanted = SimulateOutput(out, force, resume, formats, not no_pictures, quiet, as_json)
        code = run_simulate(options, wanted)
    raise typer.Exit(code)
