"""What can be measured of a mesh: quality, distance to its surface, worst elements, the certificate."""
