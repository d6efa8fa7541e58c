"""``quasirigid bench``: how long a step takes."""
