"""How good an estimate is: prediction, cross-validation, noise floor, verdicts."""
