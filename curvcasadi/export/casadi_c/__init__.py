"""CasADi's C, made fit for a flight computer."""
