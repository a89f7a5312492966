"""All designs in all states, their figure of merit, and the search beyond the grid."""
