"""Write config/<executable>.yaml of every executable from the settings it declares: ``make config`` (a test compares all of them)."""

from pathlib import Path

from lowcostnav_ros.graph.executables import EXECUTABLES, parameter_file, settings_of

FOLDER = Path(__file__).resolve().parents[1] / "config"


def main() -> None:
    """Write all files of the package itself."""
    for name in EXECUTABLES.own():
        if settings_of(name) is not None:
            (FOLDER / f"{name}.yaml").write_text(parameter_file(name), encoding="utf-8")


if __name__ == "__main__":
    main()
