(* The lemmas of docs/proof_format.rst, proved in Coq 8.16.1 with its standard library alone:  coqc proof/lemmas.v
   The last command prints every axiom that the theorems rest on. The names and letters are those of that page.

   What is assumed, as premises of the theorems (the record `hardy` and the definition `of_class`): there is a space H2 with an
   inner product and vectors k_w, |w| < 1, with <k_w, k_z> = 1 / (1 - z w* ), and multiplication by phi is a map A of that space with
   <A g, k_w> = phi(w) <g, k_w> and ||A g|| <= ||g||. That the Hardy space of the unit disc is such a space, and that every analytic
   phi with |phi| <= 1 in the unit disc is such a multiplication, are facts of analysis which are not proved here. *)
From Coq Require Import Reals Lra Psatz Lia List.
Open Scope R_scope.

(* ---- Complex numbers: pairs of real ones ---- *)
Definition C := (R * R)%type.
Declare Scope C_scope.
Delimit Scope C_scope with C.
Bind Scope C_scope with C.
Definition real (x : R) : C := (x, 0).
Definition cadd (a b : C) : C := (fst a + fst b, snd a + snd b).
Definition copp (a : C) : C := (- fst a, - snd a).
Definition csub (a b : C) : C := (fst a - fst b, snd a - snd b).
Definition cmul (a b : C) : C := (fst a * fst b - snd a * snd b, fst a * snd b + snd a * fst b).
Definition conj (a : C) : C := (fst a, - snd a).
Definition square (a : C) : R := fst a * fst a + snd a * snd a.
Definition cmod (a : C) : R := sqrt (square a).
Definition cinv (a : C) : C := (fst a / square a, - snd a / square a).
Definition cdiv (a b : C) : C := cmul a (cinv b).
Infix "+" := cadd : C_scope.
Infix "-" := csub : C_scope.
Infix "*" := cmul : C_scope.
Infix "/" := cdiv : C_scope.
Notation "- a" := (copp a) : C_scope.

Ltac parts := intros; repeat match goal with a : C |- _ => destruct a end;
  unfold cdiv, cinv, cadd, csub, cmul, copp, conj, real, square in *; simpl in *.
Ltac complex := parts; apply f_equal2; ring.

Lemma complex_ring : ring_theory (real 0) (real 1) cadd cmul csub copp (@eq C).
Proof. constructor; complex. Qed.
Add Ring complex_numbers : complex_ring.

Lemma square_nonneg a : 0 <= square a.
Proof. unfold square; nra. Qed.
Lemma cmod_nonneg a : 0 <= cmod a.
Proof. apply sqrt_pos. Qed.
Lemma cmod_square a : cmod a * cmod a = square a.
Proof. apply sqrt_sqrt, square_nonneg. Qed.
Lemma square_mul a b : square (a * b) = square a * square b.
Proof. parts; ring. Qed.
Lemma cmod_mul a b : cmod (a * b) = cmod a * cmod b.
Proof. unfold cmod; rewrite square_mul; apply sqrt_mult; apply square_nonneg. Qed.
Lemma cmod_conj a : cmod (conj a) = cmod a.
Proof. unfold cmod; f_equal; parts; ring. Qed.
Lemma cmod_opp a : cmod (- a) = cmod a.
Proof. unfold cmod; f_equal; parts; ring. Qed.
Lemma cmod_real x : cmod (real x) = Rabs x.
Proof. unfold cmod, square; simpl; rewrite <- sqrt_Rsqr_abs; unfold Rsqr; f_equal; ring. Qed.
Lemma le_of_squares x y : 0 <= y -> x * x <= y * y -> x <= y.
Proof. intros; nra. Qed.
Lemma fst_le_cmod a : Rabs (fst a) <= cmod a.
Proof.
  apply le_of_squares; [apply cmod_nonneg|]. rewrite cmod_square, <- Rabs_mult, Rabs_pos_eq; unfold square; nra.
Qed.
Lemma inner_le_cmod a b : fst a * fst b + snd a * snd b <= cmod a * cmod b.
Proof.
  apply Rle_trans with (Rabs (fst (a * conj b)%C)).
  - replace (fst a * fst b + snd a * snd b) with (fst (a * conj b)%C) by (parts; ring). apply Rle_abs.
  - rewrite <- (cmod_conj b), <- cmod_mul. apply fst_le_cmod.
Qed.
Lemma cmod_triangle a b : cmod (a + b) <= cmod a + cmod b.
Proof.
  pose proof (cmod_nonneg a); pose proof (cmod_nonneg b). apply le_of_squares; [lra|].
  pose proof (inner_le_cmod a b). pose proof (cmod_square a). pose proof (cmod_square b).
  rewrite cmod_square. unfold square in *; simpl. nra.
Qed.
Lemma square_zero a : square a = 0 -> a = real 0.
Proof. parts. apply f_equal2; nra. Qed.
Lemma div_mul a b : b <> real 0 -> (a / b * b)%C = a.
Proof.
  intros H. assert (square b <> 0) by (intros Z; apply H, square_zero, Z).
  parts. apply f_equal2; field; assumption.
Qed.
Lemma mul_cancel a b c : c <> real 0 -> (a * c = b * c)%C -> a = b.
Proof.
  intros H E. rewrite <- (div_mul a c H), <- (div_mul b c H). unfold cdiv.
  transitivity (cinv c * (a * c))%C; [ring|]. rewrite E. ring.
Qed.
Lemma conj_mul a b : conj (a * b) = (conj a * conj b)%C.
Proof. complex. Qed.
Lemma conj_add a b : conj (a + b) = (conj a + conj b)%C.
Proof. complex. Qed.
Lemma conj_conj a : conj (conj a) = a.
Proof. complex. Qed.
Lemma conj_div a b : conj (a / b) = (conj a / conj b)%C.
Proof.
  replace (conj a / conj b)%C with (conj a * conj (cinv b))%C; [apply conj_mul|].
  unfold cdiv. f_equal. unfold cinv, conj, square; simpl.
  replace (- snd b * - snd b) with (snd b * snd b) by ring. unfold Rdiv; f_equal; ring.
Qed.

(* ---- Finite sums ---- *)
Fixpoint rsum (n : nat) (f : nat -> R) : R := match n with O => 0 | S k => rsum k f + f k end.
Fixpoint csum (n : nat) (f : nat -> C) : C := match n with O => real 0 | S k => (csum k f + f k)%C end.

Lemma rsum_le n f g : (forall i, (i < n)%nat -> f i <= g i) -> rsum n f <= rsum n g.
Proof.
  induction n; intros H; simpl; [lra|]. apply Rplus_le_compat; [apply IHn; intros; apply H; lia|apply H; lia].
Qed.
Lemma rsum_scale n c f : rsum n (fun i => c * f i) = c * rsum n f.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma rsum_times_0 n f : rsum n (fun i => f i * 0) = 0.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma csum_ext n f g : (forall i, (i < n)%nat -> f i = g i) -> csum n f = csum n g.
Proof. induction n; intros H; simpl; [reflexivity|]. rewrite IHn, H; auto. Qed.
Lemma csum_add n f g : csum n (fun i => f i + g i)%C = (csum n f + csum n g)%C.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma csum_sub n f g : csum n (fun i => f i - g i)%C = (csum n f - csum n g)%C.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma csum_scale n c f : csum n (fun i => c * f i)%C = (c * csum n f)%C.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma csum_zero n : csum n (fun _ => real 0) = real 0.
Proof. induction n; simpl; [|rewrite IHn]; ring. Qed.
Lemma csum_conj n f : csum n (fun i => conj (f i)) = conj (csum n f).
Proof. induction n; simpl; [|rewrite IHn, conj_add]; [complex|reflexivity]. Qed.
Lemma csum_swap n m f : csum n (fun i => csum m (f i)) = csum m (fun j => csum n (fun i => f i j)).
Proof. induction n; simpl; [symmetry; apply csum_zero|]. rewrite csum_add, IHn. reflexivity. Qed.
Lemma csum_one n s c f : (s < n)%nat -> csum n (fun j => (if Nat.eqb j s then c else real 0) * f j)%C = (c * f s)%C.
Proof.
  assert (Z : forall k, (k <= s)%nat -> csum k (fun j => (if Nat.eqb j s then c else real 0) * f j)%C = real 0).
  { induction k; intros; simpl; [reflexivity|]. rewrite IHk by lia. replace (Nat.eqb k s) with false; [ring|].
    symmetry; apply Nat.eqb_neq; lia. }
  induction n; intros; [lia|]. simpl. destruct (Nat.eqb_spec n s) as [->|N]; [rewrite Z by lia|rewrite IHn by lia]; ring.
Qed.
Lemma cmod_csum n f : cmod (csum n f) <= rsum n (fun i => cmod (f i)).
Proof.
  induction n; simpl; [rewrite cmod_real, Rabs_R0; lra|]. pose proof (cmod_triangle (csum n f) (f n)); lra.
Qed.

(* ---- "Parameters": v <= b + E v, b + E u <= u and E u < u give v <= u ---- *)
Lemma largest n f : (0 < n)%nat -> exists i, (i < n)%nat /\ forall j, (j < n)%nat -> f j <= f i.
Proof.
  induction n; intros H; [lia|]. destruct n as [|n].
  - exists O; split; [lia|]; intros j J; replace j with O by lia; lra.
  - destruct IHn as [i [I M]]; [lia|]. destruct (Rle_dec (f i) (f (S n))) as [L|L].
    + exists (S n); split; [lia|]. intros j J. destruct (Nat.eq_dec j (S n)) as [->|]; [lra|].
      apply Rle_trans with (f i); [apply M; lia|exact L].
    + exists i; split; [lia|]. intros j J. destruct (Nat.eq_dec j (S n)) as [->|]; [lra|apply M; lia].
Qed.

Theorem parameters n (E : nat -> nat -> R) (b u v : nat -> R) :
  (forall i j, (i < n)%nat -> (j < n)%nat -> 0 <= E i j) -> (forall i, (i < n)%nat -> 0 < u i) ->
  (forall i, (i < n)%nat -> b i + rsum n (fun j => E i j * u j) <= u i) ->
  (forall i, (i < n)%nat -> rsum n (fun j => E i j * u j) < u i) ->
  (forall i, (i < n)%nat -> v i <= b i + rsum n (fun j => E i j * v j)) ->
  forall i, (i < n)%nat -> v i <= u i.
Proof.
  intros PE Pu Hb Hu Hv k K.
  destruct (largest n (fun i => v i / u i)) as [i [I M]]; [lia|]. cbv beta in M.
  assert (B : forall j, (j < n)%nat -> v j <= v i / u i * u j).
  { intros j J. specialize (M j J). specialize (Pu j J).
    replace (v j) with (v j / u j * u j) by (field; lra). apply Rmult_le_compat_r; lra. }
  set (m := v i / u i) in *.
  assert (V : v i = m * u i) by (unfold m; field; specialize (Pu i I); lra).
  assert (S : rsum n (fun j => E i j * v j) <= m * rsum n (fun j => E i j * u j)).
  { rewrite <- rsum_scale. apply rsum_le. intros j J. specialize (B j J). specialize (PE i j I J). nra. }
  specialize (Hb i I). specialize (Hu i I). specialize (Hv i I). specialize (B k K). specialize (Pu k K).
  assert (m <= 1) by (apply Rnot_lt_le; intros L; nra). nra.
Qed.

(* ---- "Modes": what a pole a_1 leaves of 1/(1 - a x), both sides times (1 - a x) (1 - a_1 x) (1 - a_1* a): with C = (1 - |a_1|^2)/(1 - a_1* a),
   1/(1 - a x) = C/(1 - a_1 x) + tau beta/(1 - a x); and 1 - |tau|^2 = (1 - |a_1|^2) (1 - |a|^2)/|1 - a_1* a|^2 ---- *)
Theorem mode_step a a1 x : ((real 1 - conj a1 * a) * (real 1 - a1 * x) =
  real (1 - square a1) * (real 1 - a * x) + (a - a1) * (x - conj a1))%C.
Proof. complex. Qed.

Theorem mode_inside a a1 : square (real 1 - conj a1 * a) - square (a - a1) = (1 - square a1) * (1 - square a).
Proof. parts; ring. Qed.

(* C = 1 + a_1* tau, so |C| is at most 1 + r_1 *)
Theorem mode_amplitude a a1 : (real 1 - conj a1 * a + conj a1 * (a - a1) = real (1 - square a1))%C.
Proof. complex. Qed.

(* ---- "A system": Schur's step maps numbers of modulus at most 1 to numbers of that kind, at every point of the disc ---- *)
Lemma schur_identity g a : square (real 1 + real g * a) - square (real g + a) = (1 - g * g) * (1 - square a).
Proof. parts; ring. Qed.

Theorem schur_step g z w : Rabs g < 1 -> cmod z < 1 -> cmod w <= 1 ->
  (real 1 + real g * (z * w) <> real 0)%C /\ cmod ((real g + z * w) / (real 1 + real g * (z * w))) <= 1.
Proof.
  intros G Z W. pose proof (cmod_nonneg z); pose proof (cmod_nonneg w).
  assert (P : 0 <= cmod z * cmod w < 1) by nra.
  assert (A : square (z * w) < 1) by (rewrite <- cmod_square, cmod_mul; nra).
  assert (B : g * g < 1) by (apply Rabs_def2 in G; nra).
  pose proof (schur_identity g (z * w)) as Q. set (a := (z * w)%C) in *. pose proof (square_nonneg (real g + a)).
  assert (D : 0 < (1 - g * g) * (1 - square a)) by (apply Rmult_lt_0_compat; lra).
  assert (N : (real 1 + real g * a <> real 0)%C).
  { intros Eq. rewrite Eq in Q. unfold square at 1 in Q; simpl in Q; lra. }
  split; [exact N|]. set (x := ((real g + a) / (real 1 + real g * a))%C).
  assert (X : square x * square (real 1 + real g * a) = square (real g + a)).
  { rewrite <- square_mul. unfold x. rewrite div_mul by exact N. reflexivity. }
  rewrite <- Q in D. apply le_of_squares; [lra|]. rewrite cmod_square. apply Rnot_lt_le. intros L. nra.
Qed.

Fixpoint schur (reflections : list R) (z : C) : C :=
  match reflections with
  | nil => real 0
  | (g :: rest)%list => (real g + z * schur rest z) / (real 1 + real g * (z * schur rest z))
  end%C.

Theorem reflections_bounded gs z : Forall (fun g => Rabs g < 1) gs -> cmod z < 1 -> cmod (schur gs z) <= 1.
Proof.
  intros G Z. induction G; simpl; [rewrite cmod_real, Rabs_R0; lra|]. apply schur_step; assumption.
Qed.

(* real coefficients: phi(z* ) = phi(z)* *)
Theorem reflections_real gs z : schur gs (conj z) = conj (schur gs z).
Proof.
  induction gs as [|g gs IH]; simpl; [complex|].
  rewrite IH, conj_div, !conj_add, !conj_mul. repeat f_equal; complex.
Qed.

(* ---- "The supremum": Cauchy-Schwarz in a space with a complex inner product ---- *)
Record space := {
  vector :> Type; zero : vector; plus : vector -> vector -> vector; times : C -> vector -> vector;
  inner : vector -> vector -> C;
  inner_zero : forall z, inner zero z = real 0;
  inner_plus : forall x y z, inner (plus x y) z = (inner x z + inner y z)%C;
  inner_times : forall c x z, inner (times c x) z = (c * inner x z)%C;
  inner_conj : forall x y, inner y x = conj (inner x y);
  inner_nonneg : forall x, 0 <= fst (inner x x) }.
Arguments zero {_}. Arguments plus {_}. Arguments times {_}. Arguments inner {_}.
Definition norm {H : space} (x : H) : R := sqrt (fst (inner x x)).

Section Spaces.
Variable H : space.
Implicit Types x y f g : H.

Lemma norm_nonneg x : 0 <= norm x.
Proof. apply sqrt_pos. Qed.
Lemma norm_square x : norm x * norm x = fst (inner x x).
Proof. apply sqrt_sqrt, inner_nonneg. Qed.
Lemma inner_times_right c x y : inner x (times c y) = (conj c * inner x y)%C.
Proof. rewrite inner_conj, inner_times, conj_mul, <- inner_conj. reflexivity. Qed.
Lemma inner_plus_right x y z : inner x (plus y z) = (inner x y + inner x z)%C.
Proof. rewrite inner_conj, inner_plus, conj_add, <- !inner_conj. reflexivity. Qed.

Theorem cauchy_schwarz x y : cmod (inner x y) <= norm x * norm y.
Proof.
  pose proof (norm_nonneg x); pose proof (norm_nonneg y).
  apply le_of_squares; [nra|]. rewrite cmod_square.
  replace (norm x * norm y * (norm x * norm y)) with (fst (inner x x) * fst (inner y y)) by (rewrite <- !norm_square; ring).
  set (M := square (inner x y)). pose proof (square_nonneg (inner x y)) as P. fold M in P.
  assert (Q : forall s, 0 <= fst (inner x x) + 2 * s * M + s * s * M * fst (inner y y)).
  { intros s. pose proof (inner_nonneg H (plus x (times (real s * inner x y) y))) as N.
    rewrite inner_plus, !inner_plus_right, !inner_times, !inner_times_right, (inner_conj H x y) in N.
    unfold M, square. revert N. generalize (inner x y), (inner x x), (inner y y).
    unfold cadd, cmul, conj, real; simpl. intros; nra. }
  pose proof (inner_nonneg H x) as A. pose proof (inner_nonneg H y) as B.
  destruct (Req_dec (fst (inner y y)) 0) as [Z|Z].
  - rewrite Z in *. apply Rnot_lt_le. intros L. specialize (Q (- (fst (inner x x) + 1) / (2 * M))).
    replace (2 * (- (fst (inner x x) + 1) / (2 * M)) * M) with (- (fst (inner x x) + 1)) in Q by (field; lra). lra.
  - specialize (Q (- / fst (inner y y))). set (b := fst (inner y y)) in *.
    replace (fst (inner x x) + 2 * - / b * M + - / b * - / b * M * b) with ((fst (inner x x) * b - M) / b) in Q by (field; exact Z).
    apply Rnot_lt_le. intros L. assert (0 < (M - fst (inner x x) * b) / b) by (apply Rdiv_lt_0_compat; lra).
    replace ((M - fst (inner x x) * b) / b) with (- ((fst (inner x x) * b - M) / b)) in * by (field; exact Z). lra.
Qed.

(* |<A g, f>| <= ||g|| ||f|| for a map that makes no vector longer, as multiplication by phi *)
Theorem contraction_bounded (A : H -> H) f g : (forall x, norm (A x) <= norm x) -> cmod (inner (A g) f) <= norm f * norm g.
Proof.
  intros K. apply Rle_trans with (1 := cauchy_schwarz _ _). specialize (K g). pose proof (norm_nonneg f). nra.
Qed.

Fixpoint combination (n : nat) (c : nat -> C) (k : nat -> H) : H :=
  match n with O => zero | S m => plus (combination m c k) (times (c m) (k m)) end.
Lemma inner_combination n c k y : inner (combination n c k) y = csum n (fun j => c j * inner (k j) y)%C.
Proof. induction n; simpl; [apply inner_zero|]. rewrite inner_plus, inner_times, IHn. reflexivity. Qed.
Lemma inner_combination_right n c k x : inner x (combination n c k) = csum n (fun j => conj (c j) * inner x (k j))%C.
Proof.
  rewrite inner_conj, inner_combination, <- csum_conj. apply csum_ext. intros. rewrite conj_mul, <- inner_conj. reflexivity.
Qed.
End Spaces.

(* The Hardy space H2 of the unit disc, as far as the page uses it *)
Record hardy := {
  functions :> space; kernel : C -> functions;
  reproducing : forall w z, cmod w < 1 -> cmod z < 1 -> inner (kernel w) (kernel z) = (real 1 / (real 1 - z * conj w))%C }.
Arguments kernel {_}.

(* An analytic phi with real coefficients and |phi| <= 1, as far as the page uses it: multiplication by phi is a contraction of H2 *)
Definition of_class (H : hardy) (phi : C -> C) : Prop :=
  (forall z, cmod z < 1 -> phi (conj z) = conj (phi z)) /\
  exists A : H -> H, (forall g, norm (A g) <= norm g) /\
    forall g w, cmod w < 1 -> inner (A g) (kernel w) = (phi w * inner g (kernel w))%C.

Section Supremum.
Variables (H : hardy) (M : nat) (node : nat -> C).
Hypothesis in_disc : forall j, (j < M)%nat -> cmod (node j) < 1.

(* what a checker computes of a function sum_j c_j k_(zeta_j): its norm, and its value at a node *)
Definition gram (c : nat -> C) : C :=
  csum M (fun j => csum M (fun l => c j * conj (c l) / (real 1 - node l * conj (node j))))%C.
Definition length (c : nat -> C) : R := sqrt (fst (gram c)).
Definition value (c : nat -> C) (z : C) : C := csum M (fun l => c l / (real 1 - z * conj (node l)))%C.
Let function (c : nat -> C) : H := combination H M c (fun j => kernel (node j)).

Lemma length_is_norm c : norm (function c) = length c.
Proof.
  unfold norm, length, gram, function. rewrite inner_combination. do 2 f_equal. apply csum_ext. intros j J.
  rewrite inner_combination_right, <- csum_scale. apply csum_ext. intros l L. rewrite reproducing by auto. unfold cdiv. ring.
Qed.
Lemma value_is_inner c z : cmod z < 1 -> inner (function c) (kernel z) = value c z.
Proof.
  intros Z. unfold function, value. rewrite inner_combination. apply csum_ext. intros l L. rewrite reproducing by auto.
  unfold cdiv. ring.
Qed.

Theorem pair_costs phi f g : of_class H phi ->
  cmod (csum M (fun j => conj (f j) * value g (node j) * phi (node j))%C) <= length f * length g.
Proof.
  intros [_ [A [K V]]]. rewrite <- !length_is_norm. apply Rle_trans with (2 := contraction_bounded H A _ _ K).
  right. f_equal. unfold function at 2. rewrite inner_combination_right. apply csum_ext. intros j J.
  rewrite V, value_is_inner by auto. ring.
Qed.

(* the residual: its norm in H2 of the harmonic measure seen from b is that of a pair whose g is k_b, divided by the norm of k_b *)
Definition residual (b : C) (c : nat -> C) : R :=
  sqrt (1 / (1 - square b) * fst (csum M (fun j => csum M (fun l =>
    let t j := c j * (real 1 - conj b * node j) in t j * conj (t l) / (real 1 - node j * conj (node l)))))%C).

Lemma one_minus_nonzero a b : cmod a < 1 -> cmod b < 1 -> (real 1 - a * conj b)%C <> real 0.
Proof.
  intros A B E. pose proof (cmod_nonneg a); pose proof (cmod_nonneg b).
  assert (P : (a * conj b)%C = real 1) by (transitivity (real 1 - (real 1 - a * conj b))%C; [ring|rewrite E; ring]).
  assert (Q : cmod (a * conj b) = 1) by (rewrite P, cmod_real; apply Rabs_R1).
  rewrite cmod_mul, cmod_conj in Q. nra.
Qed.

Theorem residual_costs phi b c : of_class H phi -> cmod b < 1 ->
  cmod (csum M (fun j => c j * phi (node j))%C) <= residual b c.
Proof.
  intros [_ [A [K V]]] B.
  set (t := fun j => (c j * (real 1 - conj b * node j))%C). set (f := fun j => conj (t j)).
  assert (G : norm (kernel b : H) * norm (kernel b : H) = 1 / (1 - square b)).
  { rewrite norm_square, reproducing by assumption. pose proof (cmod_nonneg b). pose proof (cmod_square b).
    assert (N : 1 - square b <> 0) by nra.
    replace (real 1 - b * conj b)%C with (real (1 - square b)) by complex.
    revert N. generalize (1 - square b). intros s N. parts. field. exact N. }
  assert (L : csum M (fun j => c j * phi (node j))%C = inner (A (kernel b)) (function f)).
  { unfold function. rewrite inner_combination_right. apply csum_ext. intros j J. rewrite V, reproducing by auto.
    unfold f, t. rewrite conj_conj. pose proof (one_minus_nonzero (node j) b (in_disc j J) B) as N.
    transitivity (c j * phi (node j) * (real 1 / (real 1 - node j * conj b) * (real 1 - node j * conj b)))%C; [|ring].
    rewrite div_mul by exact N. ring. }
  rewrite L. apply Rle_trans with (1 := contraction_bounded H A _ _ K). rewrite length_is_norm. unfold residual, length.
  rewrite sqrt_mult_alt by (rewrite <- G; pose proof (norm_nonneg H (kernel b)); nra).
  rewrite <- G, sqrt_square by apply norm_nonneg. rewrite Rmult_comm. right. do 3 f_equal.
  unfold gram. rewrite csum_swap. apply csum_ext. intros j J. apply csum_ext. intros l L'. unfold f. fold (t j). fold (t l).
  rewrite conj_conj. unfold cdiv. ring.
Qed.

(* factors, each a pair, and the residual that they leave: the bound of |sum_j c_j phi(zeta_j)| *)
Definition left_over (q : nat) (f g : nat -> nat -> C) (c : nat -> C) (j : nat) : C :=
  (c j - csum q (fun r => conj (f r j) * value (g r) (node j)))%C.
Definition cost (q : nat) (f g : nat -> nat -> C) (b : C) (c : nat -> C) : R :=
  rsum q (fun r => length (f r) * length (g r)) + residual b (left_over q f g c).

Theorem supremum phi q f g b c : of_class H phi -> cmod b < 1 ->
  cmod (csum M (fun j => c j * phi (node j))%C) <= cost q f g b c.
Proof.
  intros Phi B. unfold cost.
  replace (csum M (fun j => c j * phi (node j))%C) with
    (csum q (fun r => csum M (fun j => conj (f r j) * value (g r) (node j) * phi (node j)))
     + csum M (fun j => left_over q f g c j * phi (node j)))%C.
  - apply Rle_trans with (1 := cmod_triangle _ _). apply Rplus_le_compat; [|apply residual_costs; assumption].
    apply Rle_trans with (1 := cmod_csum _ _). apply rsum_le. intros r Hr. apply pair_costs, Phi.
  - rewrite csum_swap, <- csum_add. apply csum_ext. intros j J. unfold left_over.
    transitivity (phi (node j) * csum q (fun r => conj (f r j) * value (g r) (node j))
      + (c j - csum q (fun r => conj (f r j) * value (g r) (node j))) * phi (node j))%C; [|ring].
    f_equal. rewrite <- csum_scale. apply csum_ext. intros; ring.
Qed.
End Supremum.

(* ---- "Sums": what a checker accepts is true of every consistent system ---- *)
Section Question.
Variables (H : hardy) (M N : nat) (node : nat -> C) (n : nat) (P : nat -> nat -> C) (K : R).
Hypotheses (in_disc : forall j, (j < M)%nat -> cmod (node j) < 1) (gain : 0 <= K).
(* the data of the first N nodes (2N on the page), conjugates among them; eps is the level times the bound *)
Variables (y : nat -> C) (eps : nat -> R).
Variables (p : nat -> R) (phi : C -> C).

(* the system: its value at node j, P i j being the value of P_i there *)
Definition system (j : nat) : C := (csum n (fun i => real (p i) * P i j) + real K * phi (node j))%C.

(* a node whose zeta and functions are the conjugates of another's sees the conjugate value: it is consistent with y* to the same bound *)
Lemma conjugate_node j l : of_class H phi -> cmod (node j) < 1 -> node l = conj (node j) ->
  (forall i, P i l = conj (P i j)) -> system l = conj (system j).
Proof.
  intros [S _] D E Q. unfold system. rewrite E, S, conj_add, conj_mul, <- csum_conj by exact D. f_equal; [|f_equal; complex].
  apply csum_ext. intros i I. rewrite Q, conj_mul. f_equal. complex.
Qed.
Lemma conjugate_consistent j l e w : system l = conj (system j) -> cmod (system j - w) <= e -> cmod (system l - conj w) <= e.
Proof. intros E. rewrite E, <- (cmod_conj (system j - w)). replace (conj (system j - w)) with (conj (system j) - conj w)%C by complex. auto. Qed.

Hypotheses (class : of_class H phi) (consistent : forall k, (k < N)%nat -> cmod (system k - y k) <= eps k).

(* evidence: multipliers d, factors f and g, base; the functional is t(F) = sum_i T_i p_i + K sum_j tau_j phi(zeta_j) *)
Record sums := {
  multiplier : nat -> C; pairs : nat; left : nat -> nat -> C; right : nat -> nat -> C; base : C;
  at_samples : forall j, (N <= j)%nat -> multiplier j = real 0;
  base_in_disc : cmod base < 1 }.
Definition functional (tau T : nat -> C) : C :=
  (csum n (fun i => T i * real (p i)) + real K * csum M (fun j => tau j * phi (node j)))%C.
Definition rest (e : sums) (T : nat -> C) (i : nat) : C := (csum M (fun k => multiplier e k * P i k) - T i)%C.
Definition centre (e : sums) (T : nat -> C) (q : nat -> R) : C :=
  (csum M (fun k => multiplier e k * y k) - csum n (fun i => rest e T i * real (q i)))%C.
Definition radius (e : sums) (tau T : nat -> C) (u : nat -> R) : R :=
  rsum M (fun k => cmod (multiplier e k) * eps k) + rsum n (fun i => cmod (rest e T i) * u i)
  + K * cost M node (pairs e) (left e) (right e) (base e) (fun j => tau j - multiplier e j)%C.

(* t(F) - sum d y = sum d (F - y) - sum m p + K l(phi) *)
Theorem identity e tau T :
  (functional tau T - csum M (fun k => multiplier e k * y k) = csum M (fun k => multiplier e k * (system k - y k))
   - csum n (fun i => rest e T i * real (p i)) + real K * csum M (fun j => (tau j - multiplier e j) * phi (node j)))%C.
Proof.
  set (d := multiplier e).
  assert (S : csum M (fun k => d k * system k)%C =
    (csum n (fun i => csum M (fun k => d k * P i k) * real (p i)) + real K * csum M (fun k => d k * phi (node k)))%C).
  { rewrite <- csum_scale. transitivity (csum M (fun k => csum n (fun i => d k * (real (p i) * P i k))
      + real K * (d k * phi (node k)))%C).
    - apply csum_ext. intros k _. unfold system. rewrite csum_scale. ring.
    - rewrite csum_add. f_equal. rewrite csum_swap. apply csum_ext. intros i _.
      transitivity (real (p i) * csum M (fun k => d k * P i k))%C; [rewrite <- csum_scale; apply csum_ext; intros; ring|ring]. }
  replace (csum M (fun k => d k * (system k - y k)))%C with (csum M (fun k => d k * system k) - csum M (fun k => d k * y k))%C
    by (rewrite <- csum_sub; apply csum_ext; intros; ring).
  replace (csum M (fun j => (tau j - d j) * phi (node j)))%C with
    (csum M (fun j => tau j * phi (node j)) - csum M (fun j => d j * phi (node j)))%C
    by (rewrite <- csum_sub; apply csum_ext; intros; ring).
  replace (csum n (fun i => rest e T i * real (p i)))%C with
    (csum n (fun i => csum M (fun k => d k * P i k) * real (p i)) - csum n (fun i => T i * real (p i)))%C
    by (rewrite <- csum_sub; apply csum_ext; intros; unfold rest, d; ring).
  rewrite S. unfold functional. ring.
Qed.

Theorem weak_duality e tau T q u : (forall i, (i < n)%nat -> Rabs (p i - q i) <= u i) ->
  cmod (functional tau T - centre e T q) <= radius e tau T u.
Proof.
  intros U. set (l := csum M (fun j => (tau j - multiplier e j) * phi (node j))%C).
  replace (functional tau T - centre e T q)%C with (csum M (fun k => multiplier e k * (system k - y k))
    + - csum n (fun i => rest e T i * real (p i - q i)) + real K * l)%C.
  - unfold radius. apply Rle_trans with (1 := cmod_triangle _ _). apply Rplus_le_compat.
    + apply Rle_trans with (1 := cmod_triangle _ _). rewrite cmod_opp. apply Rplus_le_compat.
      * apply Rle_trans with (1 := cmod_csum _ _). apply rsum_le. intros k _. rewrite cmod_mul.
        destruct (le_lt_dec N k) as [L|L].
        { rewrite (at_samples e k L), cmod_real, Rabs_R0. lra. }
        { apply Rmult_le_compat_l; [apply cmod_nonneg|apply consistent, L]. }
      * apply Rle_trans with (1 := cmod_csum _ _). apply rsum_le. intros i I. rewrite cmod_mul, cmod_real.
        apply Rmult_le_compat_l; [apply cmod_nonneg|apply U, I].
    + rewrite cmod_mul, cmod_real, Rabs_pos_eq by exact gain. apply Rmult_le_compat_l; [exact gain|].
      apply (supremum H M node in_disc); [exact class|apply base_in_disc].
  - pose proof (identity e tau T) as I. fold l in I. unfold centre.
    replace (csum n (fun i => rest e T i * real (p i - q i)))%C with
      (csum n (fun i => rest e T i * real (p i)) - csum n (fun i => rest e T i * real (q i)))%C
      by (rewrite <- csum_sub; apply csum_ext; intros; complex).
    set (t := functional tau T) in *. set (s := csum M (fun k => multiplier e k * y k)%C) in *.
    set (m := csum n (fun i => rest e T i * real (q i))%C).
    transitivity (t - s + m)%C; [rewrite I|]; ring.
Qed.

(* "Parameters": the functional of p_i sees no node; b_i is the rest of the radius and the distance of the centres *)
Definition unit (i j : nat) : C := if Nat.eqb j i then real 1 else real 0.
Definition nowhere (_ : nat) : C := real 0.
Lemma functional_of_parameter i : (i < n)%nat -> functional nowhere (unit i) = real (p i).
Proof.
  intros I. unfold functional, unit, nowhere.
  rewrite (csum_one n i (real 1) (fun j => real (p j)) I).
  rewrite (csum_ext M _ (fun _ => real 0)) by (intros; ring). rewrite csum_zero. ring.
Qed.

Theorem parameters_proved (e : nat -> sums) (q u : nat -> R) :
  let E i j := cmod (rest (e i) (unit i) j) in
  let b i := radius (e i) nowhere (unit i) (fun _ => 0) + Rabs (fst (centre (e i) (unit i) q) - q i) in
  (forall i, (i < n)%nat -> 0 < u i) ->
  (forall i, (i < n)%nat -> b i + rsum n (fun j => E i j * u j) <= u i) ->
  (forall i, (i < n)%nat -> rsum n (fun j => E i j * u j) < u i) ->
  forall i, (i < n)%nat -> Rabs (p i - q i) <= u i.
Proof.
  intros E b Pu Hb Hu. apply (parameters n E b u (fun i => Rabs (p i - q i))); try assumption.
  - intros; apply cmod_nonneg.
  - intros i I. pose proof (weak_duality (e i) nowhere (unit i) q (fun j => Rabs (p j - q j)) (fun _ _ => Rle_refl _)) as W.
    rewrite functional_of_parameter in W by exact I. apply (Rle_trans _ _ _ (fst_le_cmod _)) in W.
    change (fst (real (p i) - centre (e i) (unit i) q)%C) with (p i - fst (centre (e i) (unit i) q)) in W. unfold b, E. unfold radius in *.
    rewrite (rsum_times_0 n (fun j => cmod (rest (e i) (unit i) j))).
    set (c := fst (centre (e i) (unit i) q)) in *. pose proof (Rabs_triang (p i - c) (c - q i)) as Tr.
    replace (p i - c + (c - q i)) with (p i - q i) in Tr by ring. lra.
Qed.

(* the three statements; s is the node of the statement's frequency, s' its conjugate *)
Section Statements.
Variables (q u : nat -> R) (e : sums) (s s' : nat).
Hypotheses (known : forall i, (i < n)%nat -> Rabs (p i - q i) <= u i) (place : (s < M)%nat) (place' : (s' < M)%nat).
Definition here (c : C) (at_node j : nat) : C := if Nat.eqb j at_node then c else real 0.
Lemma functional_here c k : (k < M)%nat -> functional (here c k) (fun i => c * P i k)%C = (c * system k)%C.
Proof.
  intros I. unfold functional, here. rewrite (csum_one M k c (fun j => phi (node j)) I). unfold system.
  replace (csum n (fun i => c * P i k * real (p i)))%C with (c * csum n (fun i => real (p i) * P i k))%C
    by (rewrite <- csum_scale; apply csum_ext; intros; ring). ring.
Qed.

Theorem disc_proved a r : let T i := P i s in
  cmod (centre e T q - a) + radius e (here (real 1) s) T u <= r -> cmod (system s - a) <= r.
Proof.
  intros T L. pose proof (weak_duality e (here (real 1) s) T q u known) as W.
  replace (functional (here (real 1) s) T) with (system s) in W.
  - pose proof (cmod_triangle (system s - centre e T q) (centre e T q - a)) as Tr.
    replace (system s - centre e T q + (centre e T q - a))%C with (system s - a)%C in Tr by ring. lra.
  - transitivity (real 1 * system s)%C; [ring|]. rewrite <- functional_here by exact place. unfold functional. f_equal.
    apply csum_ext. intros. unfold T. ring.
Qed.

Theorem support_proved (w : C) h : node s' = conj (node s) -> (forall i, P i s' = conj (P i s)) ->
  let half := (real (1 / 2) * w)%C in
  let tau j := (here half s j + here (conj half) s' j)%C in let T i := (half * P i s + conj half * P i s')%C in
  fst (centre e T q) + radius e tau T u <= h -> fst (w * system s)%C <= h.
Proof.
  intros E Q half tau T L. pose proof (weak_duality e tau T q u known) as W.
  replace (functional tau T) with (real (fst (w * system s)%C)) in W.
  - apply (Rle_trans _ _ _ (fst_le_cmod _)) in W. apply (Rle_trans _ _ _ (Rle_abs _)) in W.
    change (fst (real (fst (w * system s)%C) - centre e T q)%C) with (fst (w * system s)%C - fst (centre e T q)) in W. lra.
  - transitivity (half * system s + conj half * system s')%C.
    + rewrite (conjugate_node s s' class (in_disc s place) E Q). unfold half. generalize (system s). clear. intros x.
      parts. apply f_equal2; field.
    + rewrite <- !functional_here by assumption. unfold functional, tau, T.
      transitivity (csum n (fun i => half * P i s * real (p i)) + csum n (fun i => conj half * P i s' * real (p i))
        + real K * (csum M (fun j => here half s j * phi (node j)) + csum M (fun j => here (conj half) s' j * phi (node j))))%C;
        [ring|]. rewrite <- !csum_add. f_equal; [|f_equal]; apply csum_ext; intros; ring.
Qed.

Theorem inconsistency_proved : radius e nowhere nowhere u < cmod (centre e nowhere q) -> False.
Proof.
  intros L. pose proof (weak_duality e nowhere nowhere q u known) as W.
  replace (functional nowhere nowhere) with (real 0) in W.
  - replace (real 0 - centre e nowhere q)%C with (- centre e nowhere q)%C in W by ring. rewrite cmod_opp in W. lra.
  - unfold functional. rewrite (csum_ext n (fun i => nowhere i * real (p i))%C (fun _ => real 0)) by (intros; unfold nowhere; ring).
    rewrite (csum_ext M (fun j => nowhere j * phi (node j))%C (fun _ => real 0)) by (intros; unfold nowhere; ring).
    rewrite !csum_zero. ring.
Qed.
End Statements.
End Question.

(* ---- "Arcs": a real curve is above its chord by at most B (b - a)^2 / 8, if its second derivative is
   at least -B; with -g for g, below it by at most that if it is at most B ---- *)
Lemma convex_under_chord f f1 f2 a b t : (forall x, a <= x <= b -> derivable_pt_lim f x (f1 x)) ->
  (forall x, a <= x <= b -> derivable_pt_lim f1 x (f2 x)) -> (forall x, a <= x <= b -> 0 <= f2 x) ->
  a < t < b -> f t * (b - a) <= f a * (b - t) + f b * (t - a).
Proof.
  intros D1 D2 P [A B].
  destruct (MVT_cor2 f f1 a t A) as [x [X ?]]; [intros; apply D1; lra|].
  destruct (MVT_cor2 f f1 t b B) as [z [Z ?]]; [intros; apply D1; lra|].
  destruct (MVT_cor2 f1 f2 x z) as [w [W ?]]; [lra|intros; apply D2; lra|].
  specialize (P w ltac:(lra)). assert (L : f1 x <= f1 z) by nra.
  assert (0 <= (f1 z - f1 x) * ((t - a) * (b - t))) by (apply Rmult_le_pos; [lra|apply Rmult_le_pos; lra]).
  replace (f t) with (f a + f1 x * (t - a)) by lra. replace (f b) with (f a + f1 x * (t - a) + f1 z * (b - t)) by lra. lra.
Qed.

Theorem chord g g1 g2 B a b t : (forall x, a <= x <= b -> derivable_pt_lim g x (g1 x)) ->
  (forall x, a <= x <= b -> derivable_pt_lim g1 x (g2 x)) -> (forall x, a <= x <= b -> - B <= g2 x) ->
  0 <= B -> a < t < b -> g t - (g a * (b - t) + g b * (t - a)) / (b - a) <= B * ((b - a) * (b - a)) / 8.
Proof.
  intros D1 D2 L S T.
  assert (Q : forall x, derivable_pt_lim (fun s => B / 2 * (s * s)) x (B * x)).
  { intros x. replace (B * x) with (B / 2 * (1 * x + x * 1)) by field.
    apply (derivable_pt_lim_scal (fun s => s * s) (B / 2) x), (derivable_pt_lim_mult id id x 1 1); apply derivable_pt_lim_id. }
  assert (I : forall x, derivable_pt_lim (fun s => B * s) x B).
  { intros x. pose proof (derivable_pt_lim_scal id B x 1 (derivable_pt_lim_id x)) as Z. rewrite Rmult_1_r in Z. exact Z. }
  assert (C0 := convex_under_chord (fun s => g s + B / 2 * (s * s)) (fun s => g1 s + B * s) (fun s => g2 s + B) a b t).
  specialize (C0 ltac:(intros; apply (derivable_pt_lim_plus g); auto) ltac:(intros; apply (derivable_pt_lim_plus g1); auto)
    ltac:(intros x X; specialize (L x X); lra) T). cbv beta in C0.
  apply Rmult_le_reg_r with (b - a); [lra|].
  replace ((g t - (g a * (b - t) + g b * (t - a)) / (b - a)) * (b - a)) with (g t * (b - a) - (g a * (b - t) + g b * (t - a)))
    by (field; lra).
  assert (R : 0 <= B * (b - a) * ((2 * t - a - b) * (2 * t - a - b))) by (apply Rmult_le_pos; [nra|apply Rle_0_sqr]). lra.
Qed.

(* "Arcs": the product of two chords is within a quarter of the product of their differences of the chord of the products *)
Theorem product_of_chords (a b c d : C) t : 0 <= t <= 1 ->
  cmod ((real (1 - t) * a + real t * b) * (real (1 - t) * c + real t * d)
    - (real (1 - t) * (a * c) + real t * (b * d)))%C <= cmod (b - a) * cmod (d - c) / 4.
Proof.
  intros T. replace ((real (1 - t) * a + real t * b) * (real (1 - t) * c + real t * d)
    - (real (1 - t) * (a * c) + real t * (b * d)))%C with (- (real (t * (1 - t)) * ((b - a) * (d - c))))%C
    by (unfold real; destruct a, b, c, d; parts; apply f_equal2; ring).
  rewrite cmod_opp, !cmod_mul, cmod_real, Rabs_pos_eq by (apply Rmult_le_pos; lra).
  pose proof (Rmult_le_pos _ _ (cmod_nonneg (b - a)%C) (cmod_nonneg (d - c)%C)) as P.
  assert (Q : t * (1 - t) <= 1 / 4) by (pose proof (Rle_0_sqr (t - 1 / 2)) as S; unfold Rsqr in S; lra).
  rewrite (Rmult_comm (t * (1 - t))). apply Rle_trans with (cmod (b - a) * cmod (d - c) * (1 / 4)); [|lra].
  apply Rmult_le_compat_l; [exact P|exact Q].
Qed.

(* what is on one side of a line that does not hold 0 is as far from 0 as the line *)
Theorem apart u x l : l <= fst (conj u * x)%C -> l <= cmod u * cmod x.
Proof.
  intros L. apply Rle_trans with (1 := L), Rle_trans with (1 := Rle_abs _), Rle_trans with (1 := fst_le_cmod _).
  rewrite cmod_mul, cmod_conj. lra.
Qed.

Definition proved := (@parameters, @mode_step, @mode_inside, @mode_amplitude, @schur_step, @reflections_bounded, @reflections_real, @cauchy_schwarz,
  @contraction_bounded, @pair_costs, @residual_costs, @supremum, @identity, @weak_duality, @parameters_proved,
  @disc_proved, @support_proved, @inconsistency_proved, @chord,
  @product_of_chords, @apart).
Print Assumptions proved.
