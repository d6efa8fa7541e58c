"""The grasp of the paper: what can be chosen, the plan, the experiment, its figures."""

from quasirigid._moved import names_of

__getattr__ = names_of(__name__)
