"""Slaves that others wrote, tried for long: every function each of them has, while it is restarted in the middle.

python -m tests.real.counterparts                  # 10,000 requests to each, three restarts
python -m tests.real.counterparts --requests 500 libmodbus pymodbus-serial
"""
