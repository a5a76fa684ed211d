"""The scenarios, a file for each family and one for those that concern several."""
