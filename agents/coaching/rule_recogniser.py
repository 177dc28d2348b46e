"""The name under which scripts of others import `recognition.rule_recogniser`."""

from .recognition.rule_recogniser import RuleRecogniser

__all__ = ["RuleRecogniser"]
