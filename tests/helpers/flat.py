"""Commands called as pipeline files call them: with their options flat."""

from functools import partial

from rsa_data.common.options import call
from rsa_data.evaluation import compare as compare_module
from rsa_data.evaluation import evaluate as evaluate_module
from rsa_data.evaluation import robustness as robustness_module
from rsa_data.heads.train import train_head as train_module

train_head = partial(call, train_module.train_head)
evaluate = partial(call, evaluate_module.evaluate)
robustness = partial(call, robustness_module.robustness)
compare = partial(call, compare_module.compare)
