"""Damaged messages and files: every one is accepted and valid, or refused in one sentence."""
