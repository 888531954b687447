"""The thesis's own formulas, kept for comparison: see docs/thesis.md."""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.core.thesis import fit_closed_curve_thesis as fit_closed_curve_thesis
    from palpate.core.thesis import invert_thesis as invert_thesis, rebuild_thesis as rebuild_thesis
else:
    __getattr__, __dir__ = lazy(__name__)
