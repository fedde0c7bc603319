"""Parameter sets drawn from the joint distribution that saved results tell."""
