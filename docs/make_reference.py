"""Write the reference pages and the schema of scenarios that are made from the models that check them."""

from pathlib import Path

from crowdsim.batch.description import batch_reference
from crowdsim.scenario.reference import scenario_reference, with_outputs
from crowdsim.scenario.scenario import scenario_schema
from crowdsim.training.recipe import recipe_reference

ROOT = Path(__file__).resolve().parent.parent

if __name__ == "__main__":
    (ROOT / "docs" / "scenarios.md").write_text(scenario_reference(), encoding="utf-8")
    (ROOT / "docs" / "recipes.md").write_text(recipe_reference(), encoding="utf-8")
    (ROOT / "docs" / "batch_files.md").write_text(batch_reference(), encoding="utf-8")
    commands = ROOT / "docs" / "commands.md"
    commands.write_text(with_outputs(commands.read_text(encoding="utf-8")), encoding="utf-8")
    (ROOT / "scenarios" / "scenario.schema.json").write_text(scenario_schema(), encoding="utf-8")
