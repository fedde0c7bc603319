"""Signal processing: from a recording to smooth motion."""
