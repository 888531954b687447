"""A score as lines for people."""

from __future__ import annotations

import math
from typing import Any

from palpate.launch.score import Scored


def score_text(scored: Scored) -> str:
    """The figures of a score; lengths in mm."""
    lines = [
        _line("model", f"{scored['model']}, read in {scored['unit']}"),
        _line("reference", f"{scored['reference']}, read in {scored['reference_unit']}"),
        *_aligned(scored),
        *_distances(scored),
        _line("solid", _solid(scored)),
    ]
    if not scored["same_order_of_size"]:
        lines.append(
            _line("doubtful", "their sizes differ widely: see --unit and --reference-unit")
        )
    return "\n".join(lines)


def _aligned(scored: Scored) -> list[str]:
    if not scored["aligned"]:
        return []
    x, y, z, *axis, w = scored["pose"]
    turn = math.degrees(2.0 * math.atan2(math.hypot(*axis), abs(w)))
    place = ", ".join(f"{1000.0 * value:.3f}" for value in (x, y, z))
    rest = _mm(scored["alignment_rms_m"])
    lines = [_line("aligned", f"model moved by ({place}) mm, turned by {turn:.2f} deg; rms {rest}")]
    if not scored["alignment_converged"]:
        lines.append(_line("doubtful", "the alignment had not come to rest"))
    if scored["alignment_ambiguous"]:
        lines.append(_line("doubtful", "another pose fits as well: it looks alike from there"))
    return lines


def _distances(scored: Scored) -> list[str]:
    near = [f"rms {_mm(scored['rms_m'])}", f"p95 {_mm(scored['p95_m'])}"]
    worst = f"worst {_mm(scored['hausdorff_m'])}"
    if scored["one_sided"]:
        text = [f"mean {_mm(scored['mean_m'])}", *near, worst]
        told = (
            f"from {scored['points']} points to the model, not back: "
            "what the points do not cover is not judged"
        )
        return [_line("distance", "  ".join(text)), _line("one-sided", told)]
    text = [f"chamfer {_mm(scored['chamfer_m'])}", *near, worst]
    volume = scored["volume_error"]
    rest = [
        f"sampling floor {_mm(scored['sampling_floor_m'])}",
        f"normals {scored['normal_deg']:.1f} deg",
        "volume not known" if volume is None else f"volume {100.0 * volume:+.2f} %",
    ]
    return [_line("distance", "  ".join(text)), _line("", "  ".join(rest))]


def _solid(scored: Scored) -> str:
    parts = [
        f"watertight {'yes' if scored['watertight'] else 'NO'}",
        f"pieces {scored['components']}",
        f"holes through it {scored['genus']}" if scored["genus"] is not None else "",
        f"crossings with itself {scored['self_intersections']}",
    ]
    return "  ".join(part for part in parts if part)


def _mm(metres: Any) -> str:
    return f"{1000.0 * metres:.3f} mm"


def _line(title: str, text: str) -> str:
    return f"{title:<11}{text}"
