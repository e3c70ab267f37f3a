"""The earth: geodesy and UTM33, datums, heights, and what stands in for the ground."""
