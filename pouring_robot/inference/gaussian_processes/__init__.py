"""What no effect explains: one discrepancy, a sum of Gaussian processes over the conditions.

``processes`` defines what moves by which condition and forms inner products, ``kernels`` the functions of a condition;
``process_sum`` fits one or several processes given a hypothesis; ``discrepancy`` computes what verdicts need, sizes and
rivals.
"""
