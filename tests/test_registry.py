"""Every name that can be chosen leads somewhere."""

import subprocess
import sys
from importlib import import_module

import pytest

from rsa_data import registry
from rsa_data.cli import main
from rsa_data.common import cards
from rsa_data.common.errors import UsageError
from rsa_data.common.extras import extras
from rsa_data.runner import stages
from rsa_data.runner.stage import GIVEN

TABLES = {
    "dataset": registry.DATASETS,
    "segmenter": registry.SEGMENTERS,
    "style": registry.STYLES,
    "tokenizer": registry.TOKENIZERS,
    "encoder": registry.ENCODERS,
    "depth model": registry.DEPTH_MODELS,
    "head": registry.HEADS,
    "command": {name: target for name, (target, _) in main.COMMANDS.items()},
    "step": registry.STEPS,
    "engine": registry.ENGINES,
    "collection": registry.COLLECTIONS,
}
ENTRIES = [(kind, table, name) for kind, table in TABLES.items() for name in table]


@pytest.mark.parametrize(
    ("kind", "table", "name"), ENTRIES, ids=[f"{e[0]} {e[2]}" for e in ENTRIES]
)
def test_every_entry_resolves(kind, table, name):
    found = registry.resolve(kind, table, name)
    assert found.__doc__ or getattr(found, "help", None), "undocumented"


@pytest.mark.parametrize("name", stages.names())
def test_every_stage_builds_from_documented_options(name):
    from rsa_data.common import options

    stage = stages.stage(name)
    for option in options.parameters(stage.build):
        if option not in GIVEN:
            assert options.help_text(stage.build, option), f"{name}: {option} has no documentation"
    assert stage.name == name
    assert stage.selector in (None, *options.parameters(stage.build))


def test_unknown_names_get_the_nearest():
    with pytest.raises(UsageError, match=r"unknown encoder 'clip-rn5'. Did you mean 'clip-rn50'\?"):
        registry.resolve("encoder", registry.ENCODERS, "clip-rn5")


def test_a_missing_extra_prints_its_pip_line():
    with pytest.raises(Exception, match=r'pip install "rsa-data\[ray\]"'), extras("ray"):
        raise ModuleNotFoundError(name="ray")


@pytest.mark.parametrize("module", ["rsa_data", "rsa_data.cli.main", "rsa_data.runner.stages"])
def test_import_is_light(module):
    import subprocess
    import sys

    heavy = ("torch", "onnxruntime", "transformers")
    code = f"import {module}, sys; print([m for m in {heavy} if m in sys.modules])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
    import_module(module)


def test_what_list_reads_from_sources_is_what_the_objects_say():
    listed = ("DATASETS", "SEGMENTERS", "DECODERS", "STYLES", "TOKENIZERS", "ENCODERS",
              "IMAGE_ENCODERS", "DEPTH_MODELS", "HEADS", "LOSSES", "PROTOCOLS")  # fmt: skip
    for table in (getattr(registry, name) for name in listed):
        for name, told in registry.described(table):
            if cards.about(name) is None:
                found = registry.resolve("entry", table, name)
                assert found.__doc__.strip().partition("\n")[0] == told, name


def test_list_imports_nothing_of_what_it_lists():
    code = (
        "import sys\n"
        "from rsa_data.cli.main import cli\n"
        "cli(['list'], standalone_mode=False)\n"
        "print(sorted({'numpy', 'torch', 'pyarrow', 'onnxruntime'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
