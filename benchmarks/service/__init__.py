"""What the service must show, with a real mosquitto on this machine: python -m benchmarks.service."""
