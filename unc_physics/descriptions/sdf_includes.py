"""Included files of SDF worlds and models, put in their places."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from ..checks.errors import UncPhysicsError
from .parts import read_xml, referred

#: Attribute of a model or link from an included file: the folder to which its files are relative.
FOLDER = "__folder__"
DEPTH = 10  # largest nesting depth of models and of includes


def expand_includes(scope: Element, base: Path, prefix: str = "", depth: int = 0) -> list[str]:
    """Replace the includes of a world, model or file by what they include; return a line for each failure.

    Parameters
    ----------
    scope : Element
        It is changed.
    base : Path
        Folder to which its files are relative.
    prefix : str
        Of names in lines.
    depth : int
        Nesting depth of models and includes so far.
    """
    left_out: list[str] = []
    for include in scope.findall("include"):
        scope.remove(include)
        uri = (include.findtext("uri") or "").strip()
        try:
            model, folder, problem = _included(uri, base, depth)
        except UncPhysicsError as error:
            model, folder, problem = None, base, str(error)
        if model is None:
            left_out.append(f"{prefix}include {uri}: {problem}")
            continue
        _override(model, include)
        left_out += expand_includes(model, folder, f"{prefix}{model.get('name', 'model')}::", depth + 2)
        if include.get("merge") in ("true", "1"):
            if model.get("placement_frame"):
                left_out.append(f"{prefix}include {uri}: merge with a placement_frame is not read")
                continue
            _merge(scope, model, folder)
        else:
            model.set(FOLDER, str(folder))
            scope.append(model)
    for model in scope.findall("model"):
        if model.get(FOLDER) is None and depth <= DEPTH:
            left_out += expand_includes(model, base, f"{prefix}{model.get('name', 'model')}::", depth + 1)
    return left_out


def _included(uri, base, depth):
    """Return the model of an included file, its folder, and the reason if there is none."""
    if uri.startswith(("http://", "https://")):
        return None, base, "is on a server; download it, and name the file"
    found = referred(uri, base) if depth < DEPTH else None
    if found is not None and found.is_dir():
        found = _model_file(found)
    if found is None or not found.is_file():
        return None, base, "is not found"
    root = read_xml(found)
    model = root.find("model") if root.tag == "sdf" else None
    return model, found.parent, "is no SDF with a model"


def _model_file(folder):
    """Return the file of a folder with a model: the newest one that ``model.config`` names."""
    config = folder / "model.config"
    if config.is_file():
        root = read_xml(config)
        files = [(entry.get("version", ""), (entry.text or "").strip()) for entry in root.findall("sdf")]
        ordered = sorted(files, key=lambda item: [int(x) for x in item[0].split(".") if x.isdigit()])
        if ordered and (folder / ordered[-1][1]).is_file():
            return folder / ordered[-1][1]
    return folder / "model.sdf"


def _override(model, include):
    """Let name, pose, placement frame and ``static`` of an include replace those of its model."""
    name, placement = include.findtext("name"), include.findtext("placement_frame")
    if name is not None:
        model.set("name", name.strip())
    if placement is not None:
        model.set("placement_frame", placement.strip())
    for tag in ("pose", "static"):
        own = include.find(tag)
        if own is not None:
            for old in model.findall(tag):
                model.remove(old)
            model.append(own)
    if placement is not None and include.find("pose") is None:
        for old in model.findall("pose"):
            model.remove(old)


def _merge(scope, model, folder):
    """Put the entries of a model into another one, relative to a frame that stands for the model's own."""
    own = f"_merged__{model.get('name')}__model__"
    frame = SubElement(scope, "frame", {"name": own})
    frame.extend(model.findall("pose"))
    for entry in model:
        if entry.tag not in ("link", "frame", "joint", "model"):
            continue
        pose = entry.find("pose")
        for element, key in ((entry, "attached_to"), (pose, "relative_to")):
            if element is not None and element.get(key) == "__model__":
                element.set(key, own)
        if entry.tag == "frame" and not entry.get("attached_to"):
            entry.set("attached_to", own)
        elif entry.tag in ("link", "model"):
            pose = SubElement(entry, "pose") if pose is None else pose
            if not pose.get("relative_to"):
                pose.set("relative_to", own)
            if entry.get(FOLDER) is None:
                entry.set(FOLDER, str(folder))
        scope.append(entry)
