"""The report: one HTML page that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .recording import Recording, Traffic
from .tables import Sheet, sheets

if TYPE_CHECKING:
    from .plot import Picture


def write_report(recording: Recording, scored: dict[str, Any], path: Path) -> None:
    """Writes the page of a recording and its score to `path`."""
    parts = [_head(recording), _scores(scored), *map(_figure, _pictures(recording)), _topics(recording, scored)]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(_PAGE.format(title=escape(recording.name), style=_STYLE, body="\n".join(parts)), encoding="utf-8")


def _pictures(recording: Recording) -> Iterator[Picture]:
    from .plan_views import net_plans, vehicle_plans  # noqa: PLC0415  matplotlib is slow to import
    from .plot import style  # noqa: PLC0415
    from .traces import Traces  # noqa: PLC0415

    with style():
        yield from vehicle_plans(recording)
        yield from net_plans(recording)
        yield from Traces(recording).pictures()


def _head(recording: Recording) -> str:
    first, last = recording.span
    begun = datetime.fromtimestamp(first * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    messages = sum(traffic.log_ns.size for traffic in recording.traffic.values())
    facts = f"{begun} · {(last - first) * 1e-9:.1f} s · {len(recording.traffic)} topics · {messages} messages"
    lines = [*recording.damage, *(f"{topic}: {why}" for topic, why in recording.refused.items())]
    warnings = "".join(f"<p class=warning>{escape(line)}</p>" for line in lines)
    return f"<header><h1>{escape(recording.name)}</h1><p>{facts}</p>{warnings}</header>"


def _scores(scored: dict[str, Any]) -> str:
    """Returns the score's tables; latencies are shown with the topics."""
    found = [_sheet(sheet) for sheet in sheets({name: part for name, part in scored.items() if name != "latency"})]
    return f"<div class=scores>{''.join(found)}</div><p class=note>{_NOTE}</p>" if found else ""


def _sheet(sheet: Sheet) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in sheet.columns)
    rows = "".join(_row(row) for row in sheet.rows)
    return f"<section><h2>{escape(sheet.title)}</h2><table><tr>{head}</tr>{rows}</table></section>"


def _row(cells: tuple[str, ...]) -> str:
    name, *numbers = (escape(cell) for cell in cells)
    return f"<tr><th>{name}</th>{''.join(f'<td>{number}</td>' for number in numbers)}</tr>"


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.png).decode()
    image = f'<img alt="{escape(picture.title)}" src="data:image/png;base64,{data}">'
    return f"<figure><h2>{escape(picture.title)}</h2>{image}<figcaption>{escape(picture.caption)}</figcaption></figure>"


def _topics(recording: Recording, scored: dict[str, Any]) -> str:
    latency = scored.get("latency", {})
    rows = "".join(
        _topic(name, traffic, latency.get(name, {}), recording.span)
        for name, traffic in sorted(recording.traffic.items())
    )
    columns = ("topic", "type", "messages", "Hz", "longest gap s", "latency p50 ms", "p99 ms", "rate over time")
    head = "".join(f"<th>{column}</th>" for column in columns)
    title = "Topics, message rates and latency from stamp to recording"
    return f"<section><h2>{title}</h2><table class=topics><tr>{head}</tr>{rows}</table></section>"


def _topic(name: str, traffic: Traffic, latency: dict[str, float], span: tuple[int, int]) -> str:
    times = np.sort(traffic.log_ns)
    rate, gap = "", ""
    if times.size > 1 and times[-1] > times[0]:
        rate = f"{(times.size - 1) / ((times[-1] - times[0]) * 1e-9):.2f}"
        gap = f"{np.diff(times).max() * 1e-9:.2f}"
    late = [f"{latency[key]:.1f}" if key in latency else "" for key in ("p50_ms", "p99_ms")]
    full = escape(traffic.msgtype)
    kind = f'<span title="{full}">{full.split("/")[-1]}</span>'
    cells = (kind, str(times.size), rate, gap, *late, _sparkline(times, span))
    return f"<tr><th>{escape(name)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _sparkline(times: np.ndarray[Any, Any], span: tuple[int, int]) -> str:
    """Draws messages per bin of time, the fullest bin as high as the line."""
    if times.size < 2 or span[1] <= span[0]:
        return ""
    counts = np.histogram((times - span[0]) * 1e-9, _BINS, (0.0, (span[1] - span[0]) * 1e-9))[0]
    heights = 16 * counts / counts.max()
    path = "".join(f"V{17 - height:.1f}H{2 * (k + 1)}" for k, height in enumerate(heights))
    return f'<svg width="{2 * _BINS}" height="18" aria-hidden="true"><path d="M0 17{path}V17Z" fill="#0072B2"/></svg>'


_BINS = 40
_NOTE = "NEES/dim, NES: squared error in units of the stated variance; 1 is honest, more is overconfident."
_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", Helvetica, Arial, sans-serif; color: #222; background: #fff;
  max-width: 1000px; margin: 2.5rem auto 5rem; padding: 0 1.2rem; }
h1 { font-size: 1.7rem; font-weight: 600; margin: 0; }
h2 { font-size: 1.05rem; font-weight: 600; margin: 2.4rem 0 .5rem; }
header p { color: #555; margin: .2rem 0; }
header p.warning { color: #9a3b00; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .87rem; }
th, td { padding: .2rem 1.1rem .2rem 0; text-align: right; font-weight: normal; vertical-align: bottom; }
.scores { display: flex; flex-wrap: wrap; column-gap: 3.5rem; }
.note { color: #555; font-size: .87rem; }
tr:first-child th { color: #666; border-bottom: 1px solid #bbb; }
tr + tr th, th:first-child { text-align: left; }
.topics td:nth-child(2), .topics th:nth-child(2) { text-align: left; color: #666; }
.topics { font-size: .8rem; white-space: nowrap; }
.topics th, .topics td { padding-right: .8rem; }
figure { margin: 0; }
img { width: 100%; height: auto; }
figcaption { color: #555; font-size: .87rem; max-width: 46rem; }
@media print { figure, section { break-inside: avoid; } }
"""
_PAGE = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><style>{style}</style></head>
<body>
{body}
</body>
</html>
"""
