"""How policies are judged: seeded episodes, records, statistics, figures."""
