"""Write the consistency tables and the figure of the satellite filters into docs/gnss_only.md and docs/ins_gnss.md.

python benchmarks/consistency.py --only gnss_only,ins_gnss --json satellites.json
python benchmarks/satellite_page.py --results satellites.json
"""

import json
from pathlib import Path

import satellite_consistency
from common import run

DOCS = Path(__file__).resolve().parent.parent / "docs"
BEGIN, END = "<!-- written by benchmarks/satellite_page.py -->", "<!-- until here -->"
FIGURE = "consistency_satellites.png"
PANELS = {
    "satellites alone, PV, motion from its own model": ("gnss_only", "pv matched consistent"),
    "satellites alone, PVA, motion from its own model": ("gnss_only", "pva matched consistent"),
    "inertial, loose (epochs), low-cost unit, LD": ("ins_gnss", "epochs LD crista consistent"),
    "inertial, tight, low-cost unit, LD": ("ins_gnss", "tight LD crista consistent"),
}
COLOURS = {"position": "tab:blue", "velocity": "tab:orange", "attitude": "tab:green", "clock": "tab:grey"}


def table(results: dict) -> str:
    """All filters of one part, one row each."""
    runs = next(iter(results.values()))["flights"]
    three, two = (satellite_consistency.acceptance_band(dof, runs) for dof in (3, 2))
    note = (
        f"{runs} flights each. NEES averaged over flights and time; 3 expected (clock 2), the 95 % band of one epoch is {three[0]:.2f} to"
        f" {three[1]:.2f}\n(clock {two[0]:.2f} to {two[1]:.2f}). *Epochs inside*: share of the epochs, 20 s apart, at which the mean over"
        " the flights lies in that\nband; 95 expected, in the order of the columns. Bold: outside its band."
    )
    rows = [row for name, result in results.items() for row in satellite_consistency.rows(name, result)]
    return "\n".join([note, "", *satellite_consistency.HEAD, *rows])


def insert(page: Path, text: str) -> None:
    """Replace what lies between the two marks of a page."""
    before, _, rest = page.read_text().partition(BEGIN)
    _, found, after = rest.partition(END)
    if not found:
        raise SystemExit(f"{page} has no place for the table: put the lines '{BEGIN}' and '{END}' where it belongs.")
    page.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}")


def draw(path: Path, results: dict) -> None:
    """NEES over time, mean over the flights, with its 95 % band: four filters."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, grid = pyplot.subplots(2, 2, figsize=(10.0, 6.4), layout="constrained")
    for axes, (title, (part, name)) in zip(grid.flat, PANELS.items(), strict=True):
        result = results[part][name]
        low, high = result["nees"]["position"]["band_95"]
        axes.axhspan(low, high, color="0.9", label="95 % band, 3 expected")
        axes.axhline(3.0, color="0.6", lw=0.8)
        for quantity in ("position", "velocity", "attitude"):
            if quantity in result["nees"]:
                axes.plot(result["t_s"], result["nees"][quantity]["over_time"], lw=1.0, color=COLOURS[quantity], label=quantity)
        axes.set(title=title, xlabel="time [s]", ylabel=f"NEES, mean of {result['flights']} flights", ylim=(0.0, 8.0))
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper right", ncols=2)
    figure.savefig(path, dpi=110)


def measure(options) -> dict:
    """Write both tables and the figure."""
    results = {}
    for file in options.results.split(","):
        results |= json.loads(Path(file).read_text())
    for part in ("gnss_only", "ins_gnss"):
        insert(DOCS / f"{part}.md", table(results[part]))
    draw(DOCS / "images" / FIGURE, results)
    return {"pages": ["gnss_only.md", "ins_gnss.md"], "figure": FIGURE}


if __name__ == "__main__":
    where = {"metavar": "FILE", "required": True, "help": "JSON written by consistency.py; several with commas"}
    run(__doc__.splitlines()[0], measure, results=where)
