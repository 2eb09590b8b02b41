"""Completion of the command line for bash and zsh: ``flexgram completion bash``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

SHELLS = ("bash", "zsh")

SCRIPT = """\
# Completion of flexgram. For this shell: source <(flexgram completion {shell})
{head}_flexgram() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}}
  local verb=${{COMP_WORDS[1]}} words=
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{verbs} help" -- "$word"))
    return
  fi
  if [ "$verb" = help ]; then
    COMPREPLY=($(compgen -W "{verbs}" -- "$word"))
    return
  fi
  case "$verb $before" in
{choices}
  esac
  if [ -n "$words" ]; then
    COMPREPLY=($(compgen -W "$words" -- "$word"))
    [ ${{#COMPREPLY[@]}} -eq 0 ] || return
  fi
  case "$verb" in
{options}
  esac
  case "$word" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$word")) ;;
    *) mapfile -t COMPREPLY < <(compgen -f -- "$word") ;;
  esac
}}
complete -o filenames -F _flexgram flexgram
"""
HEADS = {"bash": "", "zsh": "autoload -Uz bashcompinit && bashcompinit\n"}


@dataclass
class Words:
    """What may stand behind a verb."""

    options: list[str] = field(default_factory=list)
    choices: dict[str, list[str]] = field(default_factory=dict)  # of an option


def words_of_program() -> dict[str, Words]:
    """Of each verb of the program, from its registry of options."""
    import _flexgram

    all_words: dict[str, Words] = {}
    for option in _flexgram.options():
        for verb in option["verbs"].split():
            words = all_words.setdefault(
                verb, Words(["-o", "-v", "-vv", "-q", "--help", "--help-all"])
            )
            name = option["short name"]
            if option["type"] == "numbered":
                continue
            words.options.append(name)
            choices = option["choices"].split("|")
            if option["choices"] and not {"yes", "true"} & set(choices):  # flags stand alone
                words.choices[name] = choices
    return all_words


def words_of_parser(parser: argparse.ArgumentParser) -> Words:
    """Of a verb of the Python package."""
    words = Words()
    for action in parser._actions:
        words.options += action.option_strings
        if action.choices and not action.option_strings:
            words.choices[""] = [str(choice) for choice in action.choices]
        if action.choices:
            for name in action.option_strings:
                words.choices[name] = [str(choice) for choice in action.choices]
    return words


def script(shell: str, parsers: Mapping[str, argparse.ArgumentParser]) -> str:
    """The script that a shell reads.

    Parameters
    ----------
    parsers : mapping
        Of the verbs of the Python package.
    """
    all_words = words_of_program()
    all_words |= {verb: words_of_parser(parser) for verb, parser in parsers.items()}

    def case(pattern: str, words: Sequence[str]) -> str:
        return f'    {pattern}) words="{" ".join(words)}" ;;'

    return SCRIPT.format(
        shell=shell,
        head=HEADS[shell],
        verbs=" ".join(all_words),
        choices="\n".join(
            case(f'"{verb} {option or verb}"', choices)
            for verb, words in all_words.items()
            for option, choices in words.choices.items()
        ),
        options="\n".join(case(verb, words.options) for verb, words in all_words.items()),
    )
