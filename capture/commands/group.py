"""Groups of commands, such as ``ps4rig rig``."""

import typer


def command_group(help_text: str) -> typer.Typer:
    """Make an empty group that prints its help when it is called without a command."""
    group = typer.Typer()

    @group.callback(invoke_without_command=True, help=help_text)
    def options(context: typer.Context) -> None:
        if context.invoked_subcommand is None:
            print(context.get_help())

    return group
