"""Which features of a cone suffice, and how three contacts may be interpreted: Fearing as data.

Tables 1.1 to 1.4 of Fung, 1999, section 1.4.3.1, one row for each combination. Where the print is
wrong, a row has the printed text and the reason why geometry refutes it.

One rule gives both counts of the text. A cone is convex, with one top and one bottom, and an edge
that bounds a touched end lies in its plane and adds no equation. So of 3 x 6 places of a face and
two edges 12 are left, and of 4 x 3 places of two faces and an edge 8.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

DISTINCT_LINES = "the edges do not lie on one line"
NOT_COLLINEAR = "the vertices do not lie on one line"
VERTEX_OFF_EDGE = "the vertex does not lie on the line of the edge"
MERIDIANS_MEET = "the meridians do not lie on one line"
LINE_OFF_PLANE = "the meridian does not lie in the plane of the face"
MERIDIAN_SLOPES = "a meridian is not parallel to an end face"
APEX_OFF_ENDS = "the apex is not on the plane of an end face"
BELOW_APEX = "a contact lies below the apex"
FACES_NOT_PARALLEL = "end and side planes are not parallel"
SIDE_OR_TOP = "the face may be side or top"
SIDE_OR_BOTTOM = "the face may be side or bottom"
SIDE_OR_END = "a face may be side or end: top if the others meet outside it, bottom if inside"
ENDS_SKEW = "the lines of an edge of the top and one of the bottom never meet: the face is a side"


class TableRow(NamedTuple):
    """One combination of features."""

    table: str  # number in the thesis
    kind: str  # type of measured geometry in tables 1.3 and 1.4, from i to v
    combination: str  # features in alphabetical order, by `Feature.name`
    # Condition of the row; in tables 1.3 and 1.4 what excludes other places for this geometry, or
    # which other places are possible as well.
    constraint: str = ""
    redundancy: int = 0  # equations less unknowns: conditions on the measured geometry
    printed: str = ""  # text of the thesis, if it differs
    refutation: str = ""  # why that is wrong, in short; docs/errata.md has the proof

    @property
    def features(self) -> tuple[str, ...]:
        """The features one by one."""
        return tuple(self.combination.split())


ORIENTATION_ROWS = (  # table 1.1
    TableRow("1.1", "", "F_T"),
    TableRow("1.1", "", "F_B"),
    TableRow("1.1", "", "E_T E_T", DISTINCT_LINES, 1),
    TableRow("1.1", "", "E_B E_B", DISTINCT_LINES, 1),
    TableRow("1.1", "", "E_B E_T", "the edges are not parallel"),
    TableRow("1.1", "", "V_T V_T V_T", NOT_COLLINEAR),
    TableRow("1.1", "", "V_B V_B V_B", NOT_COLLINEAR),
    TableRow("1.1", "", "E_T V_T", VERTEX_OFF_EDGE),
    TableRow("1.1", "", "E_B V_B", VERTEX_OFF_EDGE),
)
ORIGIN_ROWS = (  # table 1.2
    TableRow("1.2", "", "P_m P_m", MERIDIANS_MEET, 1),
    TableRow("1.2", "", "E_m E_m", MERIDIANS_MEET, 1),
    TableRow("1.2", "", "E_m P_m", MERIDIANS_MEET, 1, "P E P_m", "the subscript m belongs to E"),
    TableRow("1.2", "", "E_m F_S", LINE_OFF_PLANE),
    TableRow("1.2", "", "F_S P_m", LINE_OFF_PLANE),
    TableRow("1.2", "", "F_S F_S F_S", "no two of the faces are coplanar"),
)
FEE_ROWS = (  # table 1.3
    TableRow("1.3", "i", "E_B E_B F_T", MERIDIAN_SLOPES, 3),
    TableRow("1.3", "i", "E_B E_m F_T", MERIDIAN_SLOPES, 1),
    TableRow("1.3", "i", "E_T E_T F_B", MERIDIAN_SLOPES, 3),
    TableRow("1.3", "i", "E_T E_m F_B", MERIDIAN_SLOPES, 1),
    TableRow("1.3", "ii", "E_m E_m F_S", APEX_OFF_ENDS, 2,
             "Apex cannot be on plane F_T", "nor on that of F_B: the face could be the bottom"),
    TableRow("1.3", "iii", "E_T E_m F_S", BELOW_APEX),
    TableRow("1.3", "iv", "E_T E_T F_S", SIDE_OR_END, 1,
             "Sensed face could be side or base", "or top, where the edges meet outside the face"),
    TableRow("1.3", "iv", "E_m E_m F_T", SIDE_OR_TOP, 1,
             "Sensed face could be side or base", "two meridians meet outside a top face"),
    TableRow("1.3", "v", "E_m E_m F_B", SIDE_OR_BOTTOM, 1),
    TableRow("1.3", "v", "E_B E_m F_S", SIDE_OR_BOTTOM),
    TableRow("1.3", "v", "E_B E_B F_S", SIDE_OR_END, 1,
             "Face could be side or base", "or top, where the edges meet outside the face"),
    TableRow("1.3", "v", "E_B E_T F_S", ENDS_SKEW, 0,
             "F_S E_B P", "a parabolic point is as good as a meridian: F_S E_B E_m again"),
)  # fmt: skip
FFE_ROWS = (  # table 1.4
    TableRow("1.4", "i", "E_B F_S F_T", MERIDIAN_SLOPES, 1,
             "E . n is not 0", "it is 0 for the end face: the bottom is parallel to the top"),
    TableRow("1.4", "i", "E_T F_B F_S", MERIDIAN_SLOPES, 1,
             "E . n is not 0", "it is 0 for the end face: the top is parallel to the bottom"),
    TableRow("1.4", "ii", "E_m F_S F_S", APEX_OFF_ENDS, 1,
             "Apex cannot be on plane F_T", "nor on that of F_B, which lies farther from it"),
    TableRow("1.4", "iii", "E_m F_B F_T", FACES_NOT_PARALLEL, 2),
    TableRow("1.4", "iv", "E_m F_S F_T", SIDE_OR_TOP, 0,
             "F_T F_T E_m", "two contacts on the one top are one plane"),
    TableRow("1.4", "v", "E_m F_B F_S", SIDE_OR_BOTTOM),
    TableRow("1.4", "v", "E_T F_S F_S", SIDE_OR_END, 0,
             "Face could be side or base", "or top, where edge and other face meet outside it"),
    TableRow("1.4", "v", "E_B F_S F_S", SIDE_OR_END, 0,
             "Face could be side or base", "or top, where edge and other face meet outside it"),
)  # fmt: skip
DROPPED_ROWS = (
    TableRow("1.4", "i", "E_T E_T F_B", MERIDIAN_SLOPES, 3,
             "F_B E_T E_T", "one face and two edges belong to table 1.3 (i)"),
)  # fmt: skip
_PLACE_ROWS = {row.combination: row for row in (*FEE_ROWS, *FFE_ROWS)}


def row_of(names: Iterable[str]) -> TableRow | None:
    """The row of tables 1.3 and 1.4 with these features, in any order; None if there is none.

    `names`: three, by `Feature.name`; a parabolic point counts as a meridian edge.
    """
    meridians = ("E_m" if name == "P_m" else name for name in names)
    return _PLACE_ROWS.get(" ".join(sorted(meridians)))
