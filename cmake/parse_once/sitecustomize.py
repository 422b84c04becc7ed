"""Let the generators of ROS interfaces parse each file once; Python imports this file at its start.

Six generators run one after another, and each parses all interface files, which takes most of its time. With
this folder in PYTHONPATH, the first one saves what it parsed in the folder PARSED_INTERFACES for the others.
"""

import hashlib
import os
import pickle
import sys
import tempfile
from pathlib import Path

FOLDER = os.environ.get("PARSED_INTERFACES", "")

if FOLDER and any("rosidl" in argument for argument in sys.orig_argv[1:2]):
    from rosidl_parser import parser

    parse = parser.parse_idl_string

    def parse_once(text, png_file=None):
        """Return the content of an interface file, parsed now or by another process."""
        path = Path(FOLDER, hashlib.sha256(text.encode()).hexdigest())
        if path.exists():
            return pickle.loads(path.read_bytes())
        content = parse(text, png_file=png_file)
        with tempfile.NamedTemporaryFile(dir=FOLDER, delete=False) as file:
            pickle.dump(content, file)
        os.replace(file.name, path)
        return content

    parser.parse_idl_string = parse_once
