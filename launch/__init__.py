"""Starting graphs: launch files and scenes, checked graphs, processes, runs and their summary.

A graph is checked whole before anything is started or written; whatever a user gave and cannot be
used becomes one sentence with file and line. Launch files and scenes lie here too; limits,
displays and texts may be changed, the order of checks in `check_run` had better not. Rests on
palpate.nodes and on launch.files and launch.processes.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.launch.colours import COLOURS as COLOURS, rgb as rgb
    from palpate.launch.demand import NOISES as NOISES, read_demand as read_demand
    from palpate.launch.demand import demanded_of as demanded_of
    from palpate.launch.demand import read_mesh_setup as read_mesh_setup, read_setup as read_setup
    from palpate.launch.exchange_rate import COST_IN_REPORT as COST_IN_REPORT
    from palpate.launch.exchange_rate import COST_ON_PHONE as COST_ON_PHONE
    from palpate.launch.exchange_rate import Scale as Scale, draw_svg as draw_svg, scale as scale
    from palpate.launch.graph import Graph as Graph, ResolvedNode as ResolvedNode
    from palpate.launch.graph import override as override, plain_params as plain_params
    from palpate.launch.graph import read_arguments as read_arguments
    from palpate.launch.graph import read_settings as read_settings, resolve_nodes as resolve_nodes
    from palpate.launch.hosts import free_endpoints as free_endpoints, key_file as key_file
    from palpate.launch.hosts import read_host as read_host, run_host_agent as run_host_agent
    from palpate.launch.launch_file import arguments_table as arguments_table, describe as describe
    from palpate.launch.launch_file import list_arguments as list_arguments
    from palpate.launch.launch_source import EXPLORE as EXPLORE
    from palpate.launch.launch_source import PROCEDURES as PROCEDURES
    from palpate.launch.launch_source import find_exploration as find_exploration
    from palpate.launch.launch_source import find_launch_file as find_launch_file
    from palpate.launch.launch_source import prestart_fork_server as prestart_fork_server
    from palpate.launch.launcher import launch as launch
    from palpate.launch.node_kinds import Entry as Entry, list_kinds as list_kinds
    from palpate.launch.node_kinds import load_entry as load_entry
    from palpate.launch.node_kinds import search_current_folder as search_current_folder
    from palpate.launch.object_database import OBJECTS as OBJECTS, ObjectDatabase as ObjectDatabase
    from palpate.launch.object_database import learn_models as learn_models
    from palpate.launch.object_database import load_models as load_models
    from palpate.launch.object_database import load_objects as load_objects
    from palpate.launch.object_database import write_models as write_models
    from palpate.launch.printing import TEXT_WIDTH as TEXT_WIDTH, counted as counted
    from palpate.launch.printing import millimetres as millimetres
    from palpate.launch.printing import size_text as size_text, text_table as text_table
    from palpate.launch.printing import titled as titled
    from palpate.launch.progress import Display as Display, open_display as open_display
    from palpate.launch.run import Plan as Plan, Run as Run, check_run as check_run
    from palpate.launch.run import load_run as load_run, perform as perform, plan_run as plan_run
    from palpate.launch.run_directory import RECORDING as RECORDING, RUNS as RUNS
    from palpate.launch.run_directory import SUMMARY as SUMMARY
    from palpate.launch.run_directory import VERSIONED_PACKAGES as VERSIONED_PACKAGES
    from palpate.launch.run_directory import RunDirectory as RunDirectory
    from palpate.launch.run_directory import choose_run_directory as choose_run_directory
    from palpate.launch.run_directory import find_bag as find_bag, find_run_path as find_run_path
    from palpate.launch.run_directory import find_run_mesh as find_run_mesh, free_path as free_path
    from palpate.launch.run_directory import read_summary as read_summary
    from palpate.launch.run_directory import run_directory_of as run_directory_of
    from palpate.launch.run_directory import versions_text as versions_text
    from palpate.launch.scene import SHIPPED_SCENES as SHIPPED_SCENES, Scene as Scene
    from palpate.launch.scene import SceneSpec as SceneSpec, find_scene as find_scene
    from palpate.launch.scene import load_scene as load_scene, scene_title as scene_title
    from palpate.launch.scene import shipped_scenes as shipped_scenes
    from palpate.launch.scene import write_calibration as write_calibration
    from palpate.launch.summary_text import computing_lines as computing_lines
    from palpate.launch.summary_text import headline_facts as headline_facts
else:
    __getattr__, __dir__ = lazy(__name__)
