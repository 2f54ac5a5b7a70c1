"""How good an alarm is: ROC, false alarms per hour, trade-offs, and which alarm to choose."""
