"""What runs and studies tell: comparison, fit, characteristic numbers, rules, advice, sensitivity."""
