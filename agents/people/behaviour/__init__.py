"""Policies for roles that are not learned."""
