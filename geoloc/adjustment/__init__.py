"""All sightings of a drive → positions and shared errors with covariance, in one least-squares adjustment."""
