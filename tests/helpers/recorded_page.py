"""What a page hands to its script, and what its scene draws."""

import json
import re


def data_of(page):
    """Return what a page hands to its script."""
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))


def materials_of(commands):
    """Return the material of every object that is drawn, by its path."""
    return {
        command["path"]: command["object"]["materials"][0]
        for command in commands
        if command["type"] == "set_object"
    }
