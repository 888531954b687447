"""Many explorations at once: which ones, how they are run, and their results.

A sweep file names scenes, parameters and seeds; each run is checked before the first one starts,
depends on its own resolved parameters alone, and keeps its folder. `sweep_folder` makes and keeps
them, here or on a cluster; `results` makes the table and the page. Rests on palpate.launch.
"""
