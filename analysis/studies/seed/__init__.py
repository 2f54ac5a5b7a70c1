"""The training simulator (IROS 2016): bursts on the DAC, and the error without a fault."""
