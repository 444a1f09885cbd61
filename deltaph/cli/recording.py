"""`deltaph view`, `compare`, `export`, `paper`: recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from deltaph.cli.options import CellOption, ConnectOption, JsonOption, ZenohConfigOption, tables, write_json
from deltaph.errors import DeltaphError
from deltaph.files import check_writable


def view(
    file: Annotated[Path | None, typer.Argument(metavar="[FILE.rrd]", help="recording to open", show_default=False)] = None,
    live: Annotated[bool, typer.Option("--live", help="show a running cell instead: the same, while it happens")] = False,
    connect: ConnectOption = None,
    cell: CellOption = "cell1",
    url: Annotated[
        str | None,
        typer.Option(
            "--url", metavar="URL", help="a viewer that runs, rerun+http://127.0.0.1:9876/proxy for one; without it: a new one"
        ),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Open a recording in the Rerun viewer, or show a running cell. The viewer of a cell stays when the cell goes.

    A recording whose writer was killed is opened as a repaired copy, which is left beside it.

    Example: deltaph view paper.rrd
    Example: deltaph view --live   (then, elsewhere: deltaph run scenarios/paper.toml --realtime --wait-subscribers 1)
    """
    from deltaph.view import view_cell, view_file

    if (file is not None) == live:
        raise DeltaphError("give either a recording, FILE.rrd, or --live")
    if file is not None:
        if connect or url or zenoh_config:
            raise DeltaphError(
                "--connect, --zenoh-config and --url are for a running cell: add --live, and leave out the recording"
            )
        raise typer.Exit(view_file(file, Console(stderr=True)))
    view_cell(cell, tuple(connect or ()), url, Console(stderr=True), zenoh_config)


def compare(
    first: Annotated[Path, typer.Argument(metavar="A.rrd", help="recording A")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.rrd", help="recording to write")],
    second: Annotated[
        Path | None,
        typer.Argument(metavar="[B.rrd]", help="recording B; without it: A's plan against its plant", show_default=False),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Compare two recordings: aligned on time and on the path, differences plotted, verdicts side by side.

    Example: deltaph compare paper.rrd time_optimal.rrd -o both.rrd && deltaph view both.rrd
    """
    from deltaph.compare import compare as compare_recordings
    from deltaph.compare import print_comparison

    check_writable(json_file, binary=[output], inputs=[first, second])
    facts = compare_recordings(first, second, output)
    write_json(json_file, facts)
    print_comparison(tables(json_file), facts)
    Console(stderr=True).print(f"wrote {output}: open it with `deltaph view {output}`", style="dim", soft_wrap=True)


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE.rrd", help="recording to read")],
    csv: Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="write CSV; - is standard output")] = None,
    parquet: Annotated[Path | None, typer.Option("--parquet", metavar="FILE", help="write Parquet")] = None,
    entity: Annotated[
        str | None,
        typer.Option("--entity", metavar="ENTITY", help="only this one, such as joint/position/actual; without it: all, by time"),
    ] = None,
) -> None:
    """Write the signals of a recording as a table, under the names and in the units of `deltaph run --csv`.

    Without --entity all signals are joined on sim_time, which counts nanoseconds; the values are the run's to the last bit.
    Phase and trip are the numbers of their enumerations; operations count from 1, 0 is none. What is not
    recorded (plan.*, the plant's own tracking errors) is absent.

    Example: deltaph export paper.rrd --parquet paper.parquet --csv paper.csv
    """
    from deltaph.export import export as columns_of
    from deltaph.export import write

    if csv is None and parquet is None:
        raise DeltaphError("nothing to write: give --csv FILE, --parquet FILE or both")
    check_writable(csv, binary=[parquet], inputs=[file])
    write(columns_of(file, entity), csv, parquet)


def paper(
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE.rrd", help="recording to write")],
    json_file: JsonOption = None,
) -> None:
    """The paper's section 4: figures 4 to 8 for both methods in a recording, and its claims beside what is measured here and now.

    Example: deltaph paper -o paper.rrd && deltaph view paper.rrd
    """
    from deltaph.claims import print_claims
    from deltaph.paper import section_4

    check_writable(json_file, binary=[output])
    with Console(stderr=True).status("planning and co-simulating both methods"):
        facts = section_4(output)
    write_json(json_file, facts)
    print_claims(tables(json_file), facts["claims"], "The paper's section 4")
    Console(stderr=True).print(f"wrote {output}: open it with `deltaph view {output}`", style="dim", soft_wrap=True)
