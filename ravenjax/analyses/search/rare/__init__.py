"""How likely a rare event is: subset simulation and plain Monte Carlo, and their figure."""
