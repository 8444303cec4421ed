"""The laser's light: a guard that owns it, what is asked before it comes, and what is remembered of it.

Light is on only while something that can put it out is looking.
"""
