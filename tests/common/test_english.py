"""inflect started without its type checks says what it says with them."""

import json
import subprocess
import sys

from rsa_data.common.class_names import table
from rsa_data.common.english import engine

WITH_CHECKS = (
    "import inflect, json, sys\n"
    "e = inflect.engine()\n"
    "print(json.dumps([[e.a(n), e.plural_noun(n)] for n in json.load(sys.stdin)]))"
)


def test_words_are_those_of_inflect() -> None:
    names = list(table("coco-panoptic").names.values())[:60]
    command = [sys.executable, "-c", WITH_CHECKS]
    given = json.dumps(names)
    said = subprocess.run(command, input=given, capture_output=True, text=True, check=True).stdout
    assert [[engine().a(n), engine().plural_noun(n)] for n in names] == json.loads(said)
    import typeguard

    assert typeguard.typechecked.__name__ == "typechecked"
