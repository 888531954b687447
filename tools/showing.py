"""A solid in the browser or in a window, for `Solid.show`; either library is imported when used."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.core.rebuild import Solid


@dataclass(frozen=True)
class ShowSettings:
    """How a solid is drawn."""

    color: tuple[float, float, float] = (0.35, 0.55, 0.75)  # red, green, blue, from 0 to 1
    figure_size: float = 6.0  # [inch] side of the figure where there is no browser


def show_solid(solid: Solid, settings: ShowSettings = ShowSettings()) -> Any:
    """Show the final mesh of a solid, and print where.

    Returns viser's server, which serves this machine alone until its ``stop`` is called; or, where
    viser is not installed, the figure of matplotlib.
    """
    try:
        import viser
    except ImportError:
        return _show_figure(solid, settings)
    with redirect_stdout(io.StringIO()):  # it greets with a banner
        server = viser.ViserServer(host="127.0.0.1", label="palpate", verbose=False)
    mesh = solid.final_mesh
    server.scene.add_mesh_simple("/solid", mesh.vertices, mesh.faces, color=settings.color)
    print(f"{solid!r} is shown at http://127.0.0.1:{server.get_port()}")
    return server


def _show_figure(solid: Solid, settings: ShowSettings) -> Any:
    from matplotlib import pyplot as plt

    mesh = solid.final_mesh
    figure = plt.figure(figsize=(settings.figure_size, settings.figure_size))
    axes: Any = figure.add_subplot(projection="3d")
    x, y, z = mesh.vertices.T
    axes.plot_trisurf(x, y, z, triangles=mesh.faces, color=settings.color)
    axes.set_box_aspect(np.ptp(mesh.vertices, axis=0))
    axes.set_title(repr(solid), fontsize="small")
    plt.show()
    return figure
