"""What is on the pair now: the transaction, the silence, the replies that are still owed."""
