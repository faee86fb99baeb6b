"""Write the table of fields and units into docs/convert.md, from the kinds of messages themselves: ``make docs`` (a test compares)."""

from pathlib import Path

from lowcostnav_ros.convert.derived import ALTERNATIVES
from lowcostnav_ros.convert.units_by_name import UNITS
from lowcostnav_ros.messages.topics import TOPICS

PAGE = Path(__file__).with_name("convert.md")
BEGIN, END = "<!-- fields begin -->", "<!-- fields end -->"


def tables() -> str:
    """Fields by topic, units by dimension."""
    lines = ["| topic | field | columns | dimension | frames |", "|---|---|---|---|---|"]
    for topic, kind in TOPICS.items():
        for name, quantity in kind.fields.items():
            need = "" if quantity.required else " (optional)"
            lines.append(f"| `{topic}` | `{name}`{need} | {quantity.size} | {quantity.dimension} | {', '.join(quantity.frames)} |")
        for one in ALTERNATIVES.get(topic, ()):
            names = ", ".join(f"`{name}`" for name in one.needs) + "".join(f", `{name}` (optional)" for name in one.may)
            lines.append(f"| `{topic}` | in place of `{one.target}`: {names} | 1 each | {one.text} | |")
        if kind.options and kind.fields:
            lines.append(f"| `{topic}` | options: {', '.join(f'`{name}`' for name in kind.options)} | | | |")
    lines += ["", "| dimension | units |", "|---|---|"]
    lines += [f"| {dimension} | {', '.join(f'`{unit}`' for unit in units if unit) or 'none'} |" for dimension, units in UNITS.items()]
    return "\n".join(lines)


def page(text: str) -> str:
    """The page with the tables as the code declares them."""
    return f"{text.partition(BEGIN)[0]}{BEGIN}\n{tables()}\n{END}{text.partition(END)[2]}"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
