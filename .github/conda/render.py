"""Lets rattler-build read the recipe for conda-forge, and prints what it asks for on each system."""

from pathlib import Path

import rattler_build

RECIPE = Path(__file__).with_name("recipe.yaml").read_text("utf-8")
CHOSEN = rattler_build.VariantConfig({"c_compiler": ["gcc"], "c_stdlib": ["sysroot"]})

recipe = rattler_build.Stage0Recipe.from_yaml(RECIPE)
for system in ("linux-64", "osx-arm64", "win-64"):
    at = rattler_build.RenderConfig(platform=rattler_build.PlatformConfig(target_platform=system))
    for rendered in recipe.render(CHOSEN, at):
        print(system, *rendered.recipe.requirements.run, sep="\n  ")  # noqa: T201
