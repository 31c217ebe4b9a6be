"""``pouring-robot effects``: what a diagnosis can name."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any

from pouring_robot.cli.shared import bundles, options
from pouring_robot.exceptions import some

if TYPE_CHECKING:
    from pouring_robot.robot.model import RobotModel

_SHOWN = 6


def effects(robot: options.RobotFile = None, as_json: options.AsJson = False) -> None:
    """List the effects that a diagnosis can name: what happens, what the campaign must hold, parameters."""
    found = _library(bundles.RobotOptions(robot=robot).read())
    if as_json:
        return options.print_json({"effects": found})
    for item in found:
        options.say(f"{item['effect']}: {item['story']}", style="bold")
        instead = f", or {item['instead']}" if item["instead"] else ""
        options.print_indented(f"needs: {', '.join(item['needs']) or 'nothing but drives and measured poses'}{instead}")
        # Values of the same constant are on one line.
        for _, alike in itertools.groupby(item["forms"], lambda form: form["one_of"] or form["form"]):
            form, *others = alike
            named = [f"{p['name']} [{p['unit']}]" for p in form["parameters"] if p["main"]]
            shape = sum(not p["main"] for p in form["parameters"])
            more = f", and {shape} that shape it" if shape else ""
            name = f"form {form['form']}"
            if others:
                name += f" to {others[-1]['form']} ({1 + len(others)} values of one {form['one_of']})"
            options.print_indented(f"{name}: {some(named, _SHOWN)}{more}")


def _library(model: RobotModel) -> list[dict[str, Any]]:
    """Return the library with forms and parameters, for a campaign that has every condition."""
    from pouring_robot.diagnosis.rows import channel_names, local_parameters
    from pouring_robot.effects.available import all_effects
    from pouring_robot.effects.base import checked_forms
    from pouring_robot.effects.condition_facts import sources
    from pouring_robot.effects.conditions import bare_conditions, complete_conditions

    conditions, channels = complete_conditions(model.definition), channel_names(local_parameters(model))
    bare, warm = bare_conditions(model.definition), complete_conditions(model.definition, every_thermometer=True)
    return [
        {
            "effect": effect.id,
            "story": effect.story,
            "needs": list(sources((*effect.needs, *effect.missing(bare)), model.definition)),
            "instead": effect.substitute,
            "forms": [
                {
                    "form": form.name,
                    "one_of": form.one_of,
                    "parameters": [{"name": p.name, "unit": p.unit, "main": p.main} for p in form.parameters],
                }
                for form in checked_forms(effect, warm if effect.missing(conditions) else conditions, channels)
            ],
        }
        for effect in all_effects(model.definition).values()
    ]
