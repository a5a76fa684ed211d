"""TL-R integrated steppers: TLC and TLO 42, 57, 60 and 86."""
