from .runtime.node import Finished as Finished
from .runtime.node import Node as Node
from .runtime.node import Outputs as Outputs
from .runtime.node import Source as Source
from .runtime.node import Timed as Timed
