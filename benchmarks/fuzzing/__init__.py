"""What fuzz.py fuzzes: each importer of text or JSON through its public door, and its seeds.

An importer of several files takes one JSON object, file name -> content; a content that is a string
is written as it is, anything else as JSON. Seeds are small files in the form of real ones, and real
ones where ../shared/data has them. An `assert` that fails is an error like any other.
"""

from . import captions, datasets, heads, models, segments, work

IMPORTERS = {
    **segments.IMPORTERS,
    **datasets.IMPORTERS,
    **captions.IMPORTERS,
    **heads.IMPORTERS,
    **work.IMPORTERS,
    **models.IMPORTERS,
}
