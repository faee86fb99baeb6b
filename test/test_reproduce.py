"""The registry, the run, the page and the JSON of results, and the same numbers whoever does the work."""

import json
import re

import pytest

from lowcostnav_ros.cli import main as cli
from lowcostnav_ros.reproduce import page, registry, run
from lowcostnav_ros.reproduce.registry import (
    BETTER,
    BY_DEFINITION,
    CRASHED,
    DIFFERS,
    FITTED,
    REPRODUCED,
    Change,
    Context,
    Entry,
    Outcome,
    Reading,
    ReproduceError,
    better,
    by_definition,
    fitted,
    fitted_by,
    judged,
    read,
)

JSON_NAMES = ["id", "title", "source", "thesis", "ours", "tolerance", "verdict", "reason", "seeds", "seconds", "figure"]


def entry(id, function, study="gebre"):
    return Entry(id, f"title | of {id}", "Figure 1", "1.0 m", "5 %", study, function)


def drawn(figure):
    figure.add_subplot().plot([0.0, 1.0])


def broken(_):
    raise ZeroDivisionError("no such luck")


def test_every_result_says_what_was_printed_where_and_how_close_is_close():
    entries = registry.all_results()
    ids = [e.id for e in entries]
    assert len(set(ids)) == len(ids)
    assert {f"GR{k}" for k in range(1, 23)} <= set(ids)
    assert ids.index("GR9") < ids.index("GR10")
    for e in entries:
        assert all((e.title, e.source, e.thesis, e.tolerance)), e.id
        assert e.study in registry.STUDIES


def test_selection_by_study_and_id_and_the_nearest_name_for_a_slip():
    entries = [entry("GR2", broken), entry("GR12", broken), entry("SR1", broken, "solimeno")]
    assert [e.id for e in registry.selected([], entries)] == ["GR2", "GR12", "SR1"]
    assert [e.id for e in registry.selected(["GEBRE"], entries)] == ["GR2", "GR12"]
    assert [e.id for e in registry.selected(["sr1", "gr2"], entries)] == ["GR2", "SR1"]
    with pytest.raises(ReproduceError, match="did you mean 'GR12'"):
        registry.selected(["GR11"], entries)


def test_an_outcome_that_differs_needs_a_reason():
    with pytest.raises(ReproduceError, match="needs a reason"):
        Outcome("2 m", DIFFERS)
    with pytest.raises(ReproduceError, match="one of reproduced"):
        Outcome("2 m", "nearly")
    assert judged("1 m", True, "unused") == Outcome("1 m", REPRODUCED)
    assert judged("2 m", False).reason


def test_verdicts_that_are_no_plain_comparison():
    assert better("2 m", True, "ten times smaller", "-").verdict == BETTER
    assert better("2 m", False, "-", "larger").reason == "larger"
    assert "chosen speed; untuned: 3 m" in fitted("2 m", True, "a chosen speed", "3 m").reason
    assert fitted("2 m", True, "a", "b").verdict == FITTED
    assert fitted("2 m", False, "a", "b").verdict == DIFFERS
    assert by_definition("2 m", True, "a sum").verdict == BY_DEFINITION
    assert by_definition("3 m", False, "a sum").verdict == DIFFERS


def test_of_several_readings_the_one_that_fits_is_named():
    one, other = Reading("miles", "2 m", True), Reading("nautical miles", "3 m", False)
    assert read([other, one]).verdict == REPRODUCED
    assert read([other, one]).reason == "as the thesis must have read it: miles"
    assert read([one, one]).reason == "under every reading"
    assert read([other, one], fitted_by("a noise", "2 m"), verdict=FITTED).verdict == FITTED
    assert read([other, one], fitted_by("a noise", "2 m"), verdict=FITTED).reason.endswith("; fitted by a noise; untuned: 2 m")
    assert read([other, other]).verdict == DIFFERS


def test_the_page_shows_readings_changes_seeds_and_the_count_by_verdict():
    def computed(context):
        return read([Reading("a", "2 m", bool(context.seeds("x", 1)))])

    changed = Entry("GR2", "t", "s", "1 m", "5 %", "gebre", computed, Change("d", "v", "w"))
    text = page.page("gebre", run.run_results([changed], Context()), quick=True)
    assert "**1 reproduced**" in text
    assert "| a | 2 m | yes |" in text
    assert "- seeds flown: 1; one seed is no verdict" in text
    assert "changed on d, after a run: w; the verdict until then: v" in text


def test_seeds_shared_by_results_count_for_each():
    context = Context()
    shared = entry("GR1", lambda c: judged(str(c.once("x", lambda: c.seeds("x", 7))), True))
    assert [r.seeds for r in run.run_results([shared, shared, entry("GR2", lambda _: judged("1", True))], context)] == [7, 7, 0]


def test_an_id_is_registered_once():
    with pytest.raises(ReproduceError, match="registered twice"):
        registry.result("GR1", "another", source="-", thesis="-", tolerance="-")(broken)


def test_one_function_computes_several_results(monkeypatch):
    monkeypatch.setattr(registry, "_ENTRIES", {})

    @registry.result("ZZ1", "one", source="-", thesis="-", tolerance="-", limit=1.0)
    @registry.result("ZZ2", "two", source="-", thesis="-", tolerance="-", limit=3.0)
    def compared(_, limit):
        return judged("2", limit >= 2.0, "above")

    verdicts = {name: entry.function(Context()).verdict for name, entry in registry._ENTRIES.items()}
    assert verdicts == {"ZZ1": DIFFERS, "ZZ2": REPRODUCED}


def test_random_streams_depend_on_seed_and_name_alone():
    assert Context(seed=3).rng("a").random() == Context(seed=3, quick=True).rng("a").random()
    assert Context(seed=3).rng("a").random() != Context(seed=3).rng("b").random()
    assert Context().seeds("a", 5)[:3] == Context().seeds("a", 3)
    context, calls = Context(), []
    assert context.once("x", lambda: calls.append(1) or 7) == context.once("x", lambda: calls.append(1) or 8) == 7


def test_a_crash_is_a_verdict_and_the_others_still_run(tmp_path):
    seen = []
    records = run.run_results(
        [entry("GR1", broken), entry("GR2", lambda _: Outcome("1.01 m", REPRODUCED, "", drawn))], Context(), tmp_path, seen.append
    )
    assert [r.outcome.verdict for r in records] == [CRASHED, REPRODUCED]
    assert "no such luck" in records[0].outcome.reason
    assert "ZeroDivisionError" in records[0].trace
    assert seen == records
    assert (tmp_path / records[1].figure).stat().st_size > 1000
    assert list(records[1].as_json(tmp_path)) == JSON_NAMES


def test_equal_results_give_equal_pages_and_pictures(tmp_path):
    bytes_of = []
    for name in ("a", "b"):
        records = run.run_results([entry("GR2", lambda _: Outcome("1.01 m", REPRODUCED, "", drawn))], Context(), tmp_path / name)
        path = page.write_pages(records, tmp_path / name, quick=True)[0]
        bytes_of.append(path.read_bytes() + (tmp_path / name / records[0].figure).read_bytes())
    assert bytes_of[0] == bytes_of[1]


def test_the_page_for_a_browser_holds_its_pictures(tmp_path):
    records = run.run_results([entry("GR2", lambda _: Outcome("1.01 m", REPRODUCED, "", drawn))], Context(), tmp_path)
    text = page.write_pages(records, tmp_path, quick=True)[1].read_text()
    assert "1 reproduced" in text and "title | of GR2" in text and 'src="data:image/png;base64,' in text and "figures/" not in text


def test_page_links_rows_to_sections_and_escapes_bars():
    records = run.run_results([entry("GR2", lambda _: judged("2 m", False, "it is larger"))], Context())
    text = page.page("gebre", records, quick=False)
    assert "Gebre-Egziabher" in text
    assert "title \\| of GR2" in text
    assert "1 differs" in text
    assert "**differs**. it is larger" in text
    for anchor in re.findall(r"\]\(#(\w+)\)", text):
        assert f"## {anchor.upper()}" in text


def test_command_writes_the_json_and_the_page(tmp_path, capsys):
    out, file = tmp_path / "out", tmp_path / "results.json"
    assert cli.main(["reproduce", "GR21", "gr12", "--quick", "--out", str(out), "--json", str(file), "--workers", "1"]) == 0
    results = json.loads(file.read_text())
    assert list(results) == ["results"]
    assert [list(r) for r in results["results"]] == [JSON_NAMES] * 2
    assert [r["verdict"] for r in results["results"]] == [REPRODUCED, BY_DEFINITION]
    assert "GR21" in (out / "gebre.md").read_text()
    assert "1 reproduced, 1 by definition" in capsys.readouterr().out


def test_command_lists_and_refuses(capsys, tmp_path):
    assert cli.main(["reproduce", "--list"]) == 0
    assert "GR16" in capsys.readouterr().out
    assert cli.main(["reproduce", "GR99999"]) == 2
    assert "There is no result" in capsys.readouterr().err
    assert cli.main(["reproduce", "GR21", "--json", str(tmp_path / "none" / "x.json")]) == 2
    assert "create it first" in capsys.readouterr().err
    assert cli.main(["reproduce", "GR21", "--workers", "0"]) == 2


def test_a_quick_run_shares_out_modules_and_keeps_the_order_of_the_results():
    shared = []

    def some(function, groups):
        shared.extend([entry.id for entry in group] for group in groups)
        return [function(group) for group in groups]

    records = run.run_results(registry.selected(["GR12", "GR21", "SR9", "GR22"]), Context(quick=True, run=some))
    assert [record.entry.id for record in records] == ["GR12", "GR21", "GR22", "SR9"]
    assert sorted(shared) == [["GR12"], ["GR21", "GR22"], ["SR9"]]
