"""The card of a data set: Croissant's JSON-LD for machines, a README with Hugging Face's header, and DOI metadata."""

import datetime
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from printmend.errors import InputError
from printmend.files import replacing
from printmend_lab.dataset.parquet import BODY_COLUMNS, PRINT_COLUMNS
from printmend_lab.dataset.verify import Contents, contents

CROISSANT, README, DATACITE = "croissant.json", "README.md", "datacite.json"
_CITATION = "Utilizing a Malfunctioning 3D Printer by Modeling Its Dynamics with Machine Learning"
# Croissant's own context, version 1.0.
_CONTEXT = {
    "@language": "en", "@vocab": "https://schema.org/", "citeAs": "cr:citeAs", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"}, "equivalentProperty": "cr:equivalentProperty",
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"}, "dct": "http://purl.org/dc/terms/",
    "examples": {"@id": "cr:examples", "@type": "@json"}, "extract": "cr:extract", "field": "cr:field",
    "fileObject": "cr:fileObject", "fileProperty": "cr:fileProperty", "fileSet": "cr:fileSet", "format": "cr:format",
    "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath", "key": "cr:key",
    "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path", "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet", "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated",
    "replace": "cr:replace", "samplingRate": "cr:samplingRate", "sc": "https://schema.org/",
    "separator": "cr:separator", "source": "cr:source", "subField": "cr:subField", "transform": "cr:transform",
}  # fmt: skip
_TAGS = ("3d-printing", "hysteresis", "world-models")
_TYPES = {"string": "sc:Text", "int8": "sc:Integer", "int32": "sc:Integer", "float32": "sc:Float", "bool": "sc:Boolean"}
_PLACES = {"bodies": ("bodies/*.parquet", BODY_COLUMNS), "prints": ("prints/*/*.parquet", PRINT_COLUMNS)}
_SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (1e7, "1M<n<10M"),
          (1e8, "10M<n<100M"), (1e9, "100M<n<1B"), (1e10, "1B<n<10B"), (1e11, "10B<n<100B"))  # fmt: skip


def write_card(
    root: Path, *, name: str, url: str, creators: Sequence[str], description: str = "", doi: str = "",
) -> tuple[Path, ...]:  # fmt: skip
    """Write croissant.json, README.md and datacite.json into a data set's folder; return their paths.

    ``url`` is where it is published, ``creators`` are the names to be cited, ``doi`` is noted if there is one. The
    year of publication is this one. Raises `InputError` for a folder that holds no data set,
    or a README of someone else's.
    """
    root, found = Path(root), contents(root)
    readme = root / README
    if readme.exists() and "printmend dataset card" not in readme.read_text(encoding="utf-8", errors="replace"):
        raise InputError(readme, wanted="none, or a card of before", came="another README", todo="move it away first")
    said = description or _describe(found)
    with replacing(root / CROISSANT) as file:
        when = datetime.date.today().year
        card = croissant(found, name=name, url=url, creators=creators, description=said, doi=doi, year=when)
        file.write(json.dumps(card, indent=1, ensure_ascii=False) + "\n")
    with replacing(readme) as file:
        file.write(_readme(found, name=name, description=said, doi=doi))
    with replacing(root / DATACITE) as file:
        record = datacite(found, name=name, url=url, creators=creators, description=said, doi=doi, year=when)
        file.write(json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    return root / CROISSANT, readme, root / DATACITE


def datacite(
    found: Contents, *, name: str, url: str, creators: Sequence[str], description: str, doi: str, year: int
) -> dict[str, Any]:
    """Return a data set's metadata in DataCite's schema 4.5, which archives need to register a DOI."""
    return {
        "schemaVersion": "http://datacite.org/schema/kernel-4",
        **({"doi": doi, "identifiers": [{"identifier": doi, "identifierType": "DOI"}]} if doi else {}),
        "creators": [{"name": creator} for creator in creators],
        "titles": [{"title": name}],
        "publisher": {"name": creators[0]},
        "publicationYear": str(year),
        "types": {"resourceTypeGeneral": "Dataset", "resourceType": "Simulated prints"},
        "subjects": [{"subject": word} for word in _TAGS],
        "descriptions": [{"description": description, "descriptionType": "Abstract"}],
        "rightsList": [{"rights": licence} for licence in found.licences],
        "formats": ["application/x-parquet"],
        "sizes": [f"{found.size_bytes} bytes", f"{found.prints} prints"],
        "version": f"{found.recipe.schema}.0.0",
        "url": url,
    }


def croissant(
    found: Contents, *, name: str, url: str, creators: Sequence[str], description: str, doi: str, year: int
) -> dict[str, Any]:
    """Return a data set's description in Croissant 1.0: its files, and the columns of bodies and prints."""
    files = [
        {
            "@type": "cr:FileSet", "@id": f"{what}-files", "name": f"{what}-files", "includes": pattern,
            "encodingFormat": "application/x-parquet",
        }
        for what, (pattern, _) in _PLACES.items()
    ]  # fmt: skip
    records = [
        {
            "@type": "cr:RecordSet", "@id": what, "name": what, "description": f"A row for each position: {what}.",
            "field": [_field(what, column, kind, words) for column, (kind, words) in columns.items()],
        }
        for what, (_, columns) in _PLACES.items()
    ]  # fmt: skip
    licences = list(found.licences) or ["unknown"]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "name": name,
        "description": description,
        "url": url,
        "license": licences if len(licences) > 1 else licences[0],
        "creator": [{"@type": "sc:Person", "name": creator} for creator in creators],
        "citeAs": f"{', '.join(creators)}: {name}. {doi or url}",
        "datePublished": str(year),
        **({"identifier": f"https://doi.org/{doi}"} if doi else {}),
        "version": f"{found.recipe.schema}.0.0",
        "isLiveDataset": False,
        "distribution": files,
        "recordSet": records,
    }


def _field(what: str, column: str, kind: str, words: str) -> dict[str, Any]:
    source = {"fileSet": {"@id": f"{what}-files"}, "extract": {"column": column}}
    return {
        "@type": "cr:Field", "@id": f"{what}/{column}", "name": column, "description": words, "dataType": _TYPES[kind],
        "source": source,
    }  # fmt: skip


def _describe(found: Contents) -> str:
    recipe = found.recipe
    return (
        f"{found.bodies} bodies as layers of motor steps, and where {recipe.corruptions} broken 3-D printers "
        f"({', '.join(recipe.families)}; {recipe.severity}, seed {recipe.seed}) put the nozzle: {found.prints} "
        f"simulated prints of {found.points} positions. Made by printmend, after “{_CITATION}”."
    )


def _readme(found: Contents, *, name: str, description: str, doi: str) -> str:
    rows = found.points * found.recipe.corruptions
    size = next((text for limit, text in _SIZES if rows < limit), "100B<n<1T")
    licences = "\n".join(f"- {json.dumps(licence, ensure_ascii=False)}" for licence in found.licences)
    columns = "\n".join(
        f"| `{what}` | `{column}` | {kind} | {words} |"
        for what, (_, listed) in _PLACES.items()
        for column, (kind, words) in listed.items()
    )
    tags = "\n".join(f"- {tag}" for tag in _TAGS)
    configs = "\n".join(
        f"- config_name: {what}\n  data_files: {json.dumps(pattern)}" for what, (pattern, _) in _PLACES.items()
    )
    return f"""---
pretty_name: {json.dumps(name, ensure_ascii=False)}
license: other
license_name: of each body
task_categories:
- tabular-regression
- reinforcement-learning
tags:
{tags}
size_categories:
- {size}
configs:
{configs}
---

# {name}

{description}

Licences of the bodies, each in its line of `bodies.jsonl`:

{licences}

| files | column | type | what |
|---|---|---|---|
{columns}

`body`, `layer` and `tick` join them. `prints` has the folder's key `corruption`, the number of the broken printer in
`corruptions/`. {f"DOI: {doi}." if doi else "No DOI yet."} This page was written by `printmend dataset card`.
"""
