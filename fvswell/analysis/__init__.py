"""What runs and studies show: comparison, fit, characteristic numbers, rules, advice, sensitivity."""
