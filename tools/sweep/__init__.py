"""Many explorations at once: which ones, who makes them, and what they came to.

A sweep file names scenes, parameters and seeds; each run is checked before the first one starts,
depends on its own resolved parameters alone, and keeps its folder. `sweep_folder` makes and keeps
them, here or on a cluster; `results` is what a user gets of them. Rests on palpate.launch.
"""
