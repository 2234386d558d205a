"""Every limit at samples, a polynomial in path speed; time scaling, peaks, use."""
