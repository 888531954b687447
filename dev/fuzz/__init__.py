"""Damaged messages and files: each is accepted and valid, or refused in one sentence."""
