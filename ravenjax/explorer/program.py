"""A campaign's tick as WebAssembly, and all that a page needs to know to ask it questions: one JSON object.

`description` makes it. Numbers are single precision or 32-bit integers, binaries and motion base64 of little-endian
words. `static/engine.js` reads it:

    {
      "campaign": "quick", "robot": "raven2", "title": "Raven-II", "arms": ["gold"], "joints": ["shoulder", ..],
      "ticks": 3000,                 ms of a run, a tick each
      "limit_mm": 3.0,               distance of a hazard
      "cue": 0,                      the haptic set that the verdict counts
      "parameters": [                what a question may change, in the order of a run's inputs
        {"path": "operator.scale", "value": 0.1, "type": "float32", "unit": "", "low": 0, "high": 1, "whole": false,
         "meaning": "tip motion per hand motion"}, ..],
      "observe_ms": null,            observation after the last fault ends, or null: to the end of the run
      "slots": 1,                    faults that a run may have, at most
      "channels": [                  where faults strike; a fault's code is the channel's place in this list, from 1
        {"site": "usb_out", "layer": "USB out, motors", "arm": "gold", "channel": "shoulder", "kind": "int16",
         "unit": "counts", "low": -32768, "high": 32767, "bits": 16, "effects": ["overwrite", "latch_offset"]}, ..],
      "effects": {"overwrite": {"code": 0, "value": "number", "meaning": "x becomes the value"}, ..},
                                     "channel", "plain", "constant" where an effect of the network stands for another
      "triggers": {"time": 0}, "fields": {"code": "int32", .., "key": "uint32"},
      "motion": "..",                base64, the operator's motion: float32 columns one after the other
      "programs": {"outcomes": PROGRAM, "replay": PROGRAM},
      "verdict": {                   the words of outcomes, and what each check counts as
        "responses": [..], "told": [..], "untold": [..], "hazards": [..], "cues": [..], "halt_ms": 200,
        "checks": [{"name": "overdrive_instant", "cause": "overdrive", "response": "stopped", "unit": "DAC counts",
                    "meaning": ".."}, ..],
        "failures": ["", "tip not finite", ..], "may_be_infinite": [..], "cables": ["", "gold shoulder", ..],
        "kept_of_golden": [..]},
      "thresholds_mm": [3, 2, 4, 5],  of the haptic sets: value of parameter haptics.cues.K.threshold_m in mm
      "examples": [{"group": "dac_unchecked", "site": .., "value": .., "start_ms": .., "duration_ms": ..}, ..]
    }

A PROGRAM is a module and where its numbers stand in memory, in bytes:

    {
      "binary": "..",                base64 of a WebAssembly module; it imports env.__linear_memory, nothing else
      "width": 4,                    robots side by side in a vector
      "inputs": {"types": ["float32", ..], "offsets": [0, 16, ..], "bytes": 176},    parameters, then slots' fields
      "group_inputs": {..},          the same, one number each: of what all lanes share
      "results": {"types": .., "offsets": .., "bytes": ..}, "outcomes": ["active_ticks", ..],
      "state_bytes": 4704, "group_state_bytes": 144, "held_bytes": 2112, "row_bytes": 264,
      "series": 6,                   numbers that a golden run leaves in each tick, and a faulty run reads
      "outputs": [{"name": "gold/jpos", "type": "float32", "length": 7}, ..]     behind the series, of `replay` alone
    }
"""
