"""What a reconstruction is worth and what it cost: distances, solidity, robot time."""
