"""What every axis does, of whatever family."""
