"""The page in a real browser: no script error, every chart drawn, values at the cursor, zoom, map and player that belong together."""

import json

import numpy as np
import pytest
from browser import Browser
from replay_fakes import FakeAhrs, FakeSettings, FixFollower, flight

from lowcostnav_ros.replay.session import replay_stream
from lowcostnav_ros.replay.withhold import parse_withhold
from lowcostnav_ros.report.chart import Band, Curve, Dots, TimeAxis, time_chart
from lowcostnav_ros.report.document import document, section
from lowcostnav_ros.report.flight.page import page_of
from lowcostnav_ros.report.flight.result_folder import read_result
from lowcostnav_ros.report.map_chart import Track, map_chart


def asked(tmp_path, text, question, width=1200):
    """What a question, the body of a JavaScript function, answers in the page."""
    file = tmp_path / "page.html"
    file.write_text(text, encoding="utf-8")
    browser = Browser(tmp_path, width)
    try:
        browser.open(file.as_uri())
        answer = browser.value(f"(async () => {{ await window.pageReady; {question} }})()")
        assert browser.errors == []
    finally:
        browser.close()
    return answer


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("result")
    navigators = {"follower": FixFollower(FakeSettings(north_bias_m=3.0)), "ahrs": FakeAhrs(FakeSettings())}
    summary = replay_stream(flight(30), navigators, (parse_withhold("gps/fix@10-22"),), out=out)
    (out / "summary.json").write_text(json.dumps(summary.to_mapping()))
    return read_result(out)


def test_a_report_works_in_a_browser(result, tmp_path):
    answer = asked(tmp_path, page_of(result), """
        document.querySelectorAll('details').forEach(d => d.open = true);
        page.fit();
        const drawn = page.charts.filter(c => c.axes.children.length > 2 && +c.plot.getAttribute('width') > 50).length;
        const [a, b] = [page.main.t0 + 5, page.main.t0 + 15], north = page.charts.find(c => /^North error/.test(c.svg.ariaLabel));
        const svg = north.svg, box = svg.getBoundingClientRect();
        const send = (type, t) => svg.dispatchEvent(new PointerEvent(type, {pointerId: 1, pointerType: 'mouse', button: 0, bubbles: true,
          clientX: box.left + north.x(t) / north.width * box.width, clientY: box.top + 60}));
        svg.setPointerCapture = () => {};
        page.charts.forEach(c => c.seen = true);
        send('pointermove', a);
        const text = document.getElementById('when').innerText;
        send('pointerdown', a); send('pointermove', b); send('pointerup', b);
        const view = [page.main.a, page.main.b], shown = page.main.charts.map(c => c.plot.getAttribute('viewBox').split(' ').map(Number));
        const value = north.at(page.main.t0 + 12);
        goTo(page.main.t0 + 12);
        const crafts = [...document.querySelectorAll('.craft')].map(g => g.getAttribute('transform'));
        const ground = page.grounds[0], pin = ground.pins[0].getAttribute('transform');
        ground.zoom(0.5);
        const moved = [...document.querySelectorAll('.craft')].map(g => g.getAttribute('transform'));
        document.getElementById('unzoom').click();
        const by = document.querySelector('#player .by'), who = document.querySelector('#player .who');
        who.value = 'follower'; who.dispatchEvent(new Event('change'));
        const painted = ['error_m', 'ratio', 'mode'].map(v => { by.value = v; by.dispatchEvent(new Event('change'));
          return document.querySelectorAll('.painted path').length; });
        document.querySelector('#player .play').click();
        const playing = document.querySelector('#player .play').textContent;
        const scales = [...document.querySelectorAll('svg.map .axes text')].map(t => t.textContent);
        return {painted, playing, scales, charts: document.querySelectorAll('svg.chart').length, drawn, text, view, shown, crafts, moved,
          whole: page.main.charts.every(c => c.plot.getAttribute('viewBox').startsWith('0 ')),
          horizon: [...document.querySelector('.horizon canvas').getContext('2d').getImageData(0, 0, 200, 100).data].some(v => v),
          bands: value.filter(v => v[0].kind === 'band').length, error: value.find(v => v[0].kind === 'curve')[1],
          pinMoved: pin !== ground.pins[0].getAttribute('transform'), contents: document.querySelectorAll('nav a').length}""")  # fmt: skip
    assert answer["charts"] == answer["drawn"] > 8 and answer["contents"] > 4
    assert any(t.endswith((" NM", " ft")) for t in answer["scales"]) and any(t.endswith((" km", " m")) for t in answer["scales"])
    assert "0:05.0" in answer["text"] and "sigma:" in answer["text"] and " m" in answer["text"]
    # a drag from 5 to 15 s zooms every chart of the flight to that, and one click shows all again
    first = result.summary.first_stamp_s
    assert np.allclose(np.subtract(answer["view"], first), [5.0, 15.0], atol=0.1) and answer["whole"]
    assert all(np.allclose((x, w), (shown_x, shown_w)) for x, _, w, _ in answer["shown"] for shown_x, _, shown_w, _ in answer["shown"][:1])
    errors = result.navigators["follower"].errors
    known = np.isfinite(errors["north_m"])
    expected = np.interp(first + 12.0, errors["t_s"][known], errors["north_m"][known])
    assert answer["bands"] == 1 and answer["error"] == pytest.approx(expected, abs=0.05)
    assert min(answer["painted"]) > 0 and answer["playing"] != "\N{BLACK RIGHT-POINTING TRIANGLE}"
    assert answer["crafts"] and answer["crafts"] != answer["moved"] and answer["pinMoved"] and answer["horizon"]


def test_any_quantity_is_drawn_and_units_are_those_of_the_cockpit(result, tmp_path):
    long = document("x", [section("First", "a" * 300_000), section("Later", f"<p id='late'>{'b' * 20_000}</p>")])
    assert "bbb" not in long and len(asked(tmp_path, long, "return document.getElementById('late').textContent")) == 20_000
    answer = asked(tmp_path, page_of(result), """
        await page.drawField('follower.height_m - truth.height_m');
        await page.drawField('follower.lon_deg * 2');
        const [[formula], [twice]] = page.charts.slice(-2).map(c => c.items()), refused = [];
        for (const text of ['nothing.at_all', '', 'alert(1);', 'follower.height_m +', 'a[0]']) {
          await page.drawField(text);
          refused.push(document.getElementById('not-drawn').textContent);
        }
        page.fit();
        const tables = () => [...document.querySelectorAll('table')].map(t => t.textContent).join();
        const titles = () => page.charts.map(c => c.title?.textContent), north = page.charts.find(c => /^North error/.test(c.said));
        const before = [titles(), tables()], shown = north.axes.textContent;
        document.getElementById('units').click();
        const after = [titles(), tables()], cockpit = north.axes.textContent;
        document.getElementById('units').click();
        return {formula: formula.parts[0], twice: twice.parts[0], refused, before, after, shown, cockpit,
          same: JSON.stringify(before) === JSON.stringify([titles(), tables()])}""")
    follower = result.navigators["follower"]
    expected = 2.0 * np.interp(answer["twice"][0], follower.solutions["t_s"], follower.solutions["lon_deg"])
    assert np.allclose(answer["twice"][1], expected, rtol=0.0, atol=0.01 * np.ptp(expected)) and np.ptp(expected) > 0.0
    assert answer["formula"][1] and all(text.startswith("Not drawn: ") for text in answer["refused"])
    assert any("North error [m]" in t for t in filter(None, answer["before"][0]))
    assert any("North error [ft]" in t for t in filter(None, answer["after"][0]))
    assert answer["shown"] != answer["cockpit"] and answer["before"][1] != answer["after"][1] and answer["same"]


def test_a_page_without_a_flight_works_on_a_telephone(tmp_path):
    t = np.arange(0.0, 100.0, 0.1)
    axis = TimeAxis(0.0, 100.0, [(20.0, 30.0)])
    items = [Band(t, 1.0 + 0.0 * t, "#00f"), Curve(t, np.sin(t), "#000", "sine"), Dots(t[::50], np.cos(t[::50]), "#f00", "cosine")]
    charts = time_chart("Sine [m]", axis, items), time_chart("Other [m]", TimeAxis(0.0, 7.0), [Curve(t[:70], t[:70], "#000", "line")])
    ground = map_chart([Track(np.array([47.0, 47.1]), np.array([8.0, 8.1]), "#000", "way")])
    answer = asked(tmp_path, document("name", [section("Charts", *charts, ground)]), """
        page.fit();
        const [sine, line] = page.charts;
        sine.seen = line.seen = true;
        page.show(sine.view, 40, 50);
        const [band, curve, dots] = ['band', 'curve', 'dots'].map(kind => sine.items().find(i => i.kind === kind));
        return {width: sine.width, wide: document.documentElement.scrollWidth <= innerWidth,
          other: line.view.b, at: sine.at(45.0).map(v => v[1]),
          range: [sine.low, sine.high], points: dots.parts[0][0].length,
          tick: sine.axes.querySelector('.tick').getBoundingClientRect().height}
        """, width=400)  # fmt: skip
    assert answer["width"] < 500 and answer["wide"] and answer["tick"] > 8.0  # text as large as on a desk
    assert answer["other"] == 7.0  # another axis is not moved
    assert answer["at"] == pytest.approx([1.0, np.sin(45.0), np.cos(45.0)], abs=0.005) and answer["points"] == 20
    assert answer["range"][1] == pytest.approx(2.0 * 1.06, abs=0.2)  # two sigma and a margin


def test_on_a_telephone_a_title_and_the_names_of_the_curves_take_as_many_lines_as_they_need(tmp_path):
    t_s = np.arange(60.0)
    curves = [Curve(t_s, k + np.sin(t_s), "#1f77b4", f"a curve with quite a name, {k}") for k in range(4)]
    chart = time_chart("Expected error [m] of the backup navigator, GPS lost at the start, against time", TimeAxis(0.0, 60.0), curves)
    boxes = """page.fit(); const svg = document.querySelector('svg.chart'), r = svg.getBoundingClientRect();
        const of = e => { const b = e.getBoundingClientRect();
          return [b.left - r.left, b.right - r.left, b.top - r.top, b.bottom - r.top]; };
        return {width: r.width, lines: [...svg.querySelectorAll('.title tspan')].length, room: parseFloat(svg.style.marginTop),
          title: of(svg.querySelector('.title')), keys: [...svg.querySelectorAll('.key')].map(of)}"""
    answer = asked(tmp_path, document("page", [section("Drawn", chart)]), boxes, width=400)
    assert answer["lines"] > 1 and answer["title"][1] <= answer["width"] and -answer["title"][2] < answer["room"] + 4
    tops = [key[2] for key in answer["keys"]]
    assert len(set(tops)) == len(tops) and all(key[1] <= answer["width"] for key in answer["keys"])
    assert min(tops) >= answer["title"][3] - 4  # below the title
