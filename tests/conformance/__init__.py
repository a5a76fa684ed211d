"""What every family promises, tried on each: those of this package, and one that is made up."""
