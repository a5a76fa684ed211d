"""Armed watchdogs: admission, feeding, leases, arming and release."""
