"""The methods page: three methods that need no rate table, with their guidance, recordings and pictures."""
