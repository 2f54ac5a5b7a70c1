"""A monitor as C: one struct that is remembered, one function a millisecond, no allocation, C99 and
<math.h> alone.

The operations are the part's in their order, each rounded to float by itself (subtract, divide,
compare: there is no sum of products that a compiler could fuse), so any compiler that keeps IEEE
arithmetic gives the part's bits; -ffast-math does not keep it.
"""

from __future__ import annotations

from ravenjax.analyses.monitors.monitor import Monitor, read_of, reads
from ravenjax.analyses.monitors.scores import Score

HEADER, SOURCE, TEST = "monitor.h", "monitor.c", "monitor_test.c"


def header(monitor: Monitor, notes: list[str]) -> str:
    """monitor.h. notes: what the monitor promises, in lines."""
    units = {}
    for term in monitor.terms:
        for field in filter(None, (term.signal, term.against)):
            units[read_of(term, field)] = term.units[0]
    inputs = [
        f"  float {name};{_unit(units.get(name, ''))}"
        for name in reads(monitor.terms, monitor.segments)
    ]
    before = [
        f"  float before_{read_of(term, term.signal)};"
        for term in monitor.terms
        if term.kind == "rate"
    ]
    comment = "\n".join(f" * {note}".rstrip() for note in notes)
    return f"""/*
{comment}
 *
 * One monitor_state an arm: monitor_init once, then monitor_step each millisecond, also while the robot is not live.
 * Whole numbers are converted by (float). Compile without -ffast-math.
 */
#ifndef MONITOR_H
#define MONITOR_H

#define MONITOR_THRESHOLD {_number(monitor.threshold)}

typedef struct {{
{chr(10).join(inputs)}
}} monitor_inputs;

typedef struct {{
  int begun;
{chr(10).join([*before, "  float score; /* of this millisecond; 0 while not live */"])}
}} monitor_state;

void monitor_init(monitor_state *state);

/* live: the robot follows the operator (see monitor.toml). Returns 1 for an alarm, else 0. */
int monitor_step(monitor_state *state, const monitor_inputs *now, int live);

#endif
"""  # noqa: E501


def source(monitor: Monitor) -> str:
    """monitor.c."""
    names = list(reads(monitor.terms, monitor.segments))
    before = [read_of(term, term.signal) for term in monitor.terms if term.kind == "rate"]
    lines = [f"  const float {name} = number(now->{name});" for name in names]
    lines += ["  float one, score = 0.0f;", ""]
    for k, term in enumerate(monitor.terms):
        lines += _term(monitor, k, term)
    lines += ["", *(f"  state->before_{name} = {name};" for name in before), "  state->begun = 1;"]
    lines += ["  state->score = live ? score : 0.0f;", "  return state->score > MONITOR_THRESHOLD;"]
    init = [f"  state->before_{name} = 0.0f;" for name in before]
    newline = "\n"
    return f"""#include "monitor.h"

#include <math.h>

static float number(float x) {{ return x == x ? x : 0.0f; }}

void monitor_init(monitor_state *state) {{
  state->begun = 0;
{newline.join([*init, "  state->score = 0.0f;"])}
}}

int monitor_step(monitor_state *state, const monitor_inputs *now, int live) {{
{newline.join(lines)}
}}
"""


def test(monitor: Monitor) -> str:
    """monitor_test.c: a main that runs test_vector.csv through the monitor and wants the same
    bits.
    """
    names = list(reads(monitor.terms, monitor.segments))
    reading = "\n".join(f"    now.{name} = strtof(at, &at); at += *at == ',';" for name in names)
    return f"""/* cc -std=c99 monitor.c monitor_test.c -lm && ./a.out test_vector.csv */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "monitor.h"

int main(int count, char **words) {{
  static char line[65536];
  monitor_state state;
  monitor_inputs now;
  long rows = 0, wrong = 0, alarms = 0;
  FILE *file = count > 1 ? fopen(words[1], "r") : NULL;
  if (!file || !fgets(line, sizeof line, file)) {{
    fprintf(stderr, "usage: %s test_vector.csv\\n", words[0]);
    return 2;
  }}
  monitor_init(&state);
  while (fgets(line, sizeof line, file)) {{
    char *at = line;
    float expected;
    int live, alarm;
    strtol(at, &at, 10); at += *at == ',';
    live = (int)strtol(at, &at, 10); at += *at == ',';
{reading}
    expected = strtof(at, &at); at += *at == ',';
    alarm = (int)strtol(at, &at, 10);
    wrong += monitor_step(&state, &now, live) != alarm || memcmp(&state.score, &expected, sizeof expected) != 0;
    alarms += alarm;
    rows++;
  }}
  fclose(file);
  printf("%ld milliseconds, %ld in alarm, %ld differ\\n", rows, alarms, wrong);
  return rows == 0 || wrong != 0;
}}
"""  # noqa: E501


def _term(monitor: Monitor, k: int, term: Score) -> list[str]:
    own, scales = read_of(term, term.signal), monitor.scales[k]
    size = {
        "bound": f"fabsf({own})",
        "residual": f"fabsf({own} - {read_of(term, term.against)})",
        "rate": f"(state->begun ? fabsf({own} - state->before_{own}) : 0.0f)",
    }[term.kind]
    scale = _number(scales[0])
    for edge, later in zip(monitor.segments.edges, scales[1:], strict=True):
        scale = f"({monitor.segments.field} >= {_number(edge)} ? {_number(later)} : {scale})"
    words = term.words.replace("*/", "")
    return [f"  one = {size} / {scale}; /* {words} */", "  if (one > score) score = one;"]


def _unit(unit: str) -> str:
    return f" /* {unit} */" if unit else ""


def _number(value: float) -> str:
    """A float32 as C reads it back: nine digits are enough."""
    digits = f"{value:.9g}"
    return f"{digits if any(mark in digits for mark in '.e') else f'{digits}.0'}f"
