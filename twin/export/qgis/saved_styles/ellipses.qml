<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="Symbology|Labeling|Fields|Forms|MapTips|Rendering" hasScaleBasedVisibilityFlag="1" minScale="10000" maxScale="0" labelsEnabled="0">
 <renderer-v2 type="categorizedSymbol" attr="if(&quot;cep95_m&quot; &gt; 1, 'wide', 'within')" symbollevels="0" forceraster="0" enableorderby="0">
  <categories>
   <category symbol="0" value="within" label="CEP95 up to 1 m" render="true" />
   <category symbol="1" value="wide" label="CEP95 over 1 m" render="true" />
  </categories>
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="27,42,65,38" />
      <Option name="style" type="QString" value="solid" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_style" type="QString" value="solid" />
      <Option name="outline_width" type="QString" value="0.3" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="color" v="27,42,65,38" />
     <prop k="style" v="solid" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_style" v="solid" />
     <prop k="outline_width" v="0.3" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
   <symbol type="fill" name="1" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="27,42,65,38" />
      <Option name="style" type="QString" value="solid" />
      <Option name="outline_color" type="QString" value="27,42,65,255" />
      <Option name="outline_style" type="QString" value="dash" />
      <Option name="outline_width" type="QString" value="0.3" />
      <Option name="outline_width_unit" type="QString" value="MM" />
      <Option name="joinstyle" type="QString" value="round" />
     </Option>
     <prop k="color" v="27,42,65,38" />
     <prop k="style" v="solid" />
     <prop k="outline_color" v="27,42,65,255" />
     <prop k="outline_style" v="dash" />
     <prop k="outline_width" v="0.3" />
     <prop k="outline_width_unit" v="MM" />
     <prop k="joinstyle" v="round" />
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <fieldConfiguration />
 <aliases>
  <alias field="estimate_id" index="1" name="Estimate" />
  <alias field="object" index="2" name="Annotated object" />
  <alias field="sigma_major_m" index="3" name="Standard deviation along the error ellipse (m)" />
  <alias field="sigma_minor_m" index="4" name="Standard deviation across the error ellipse (m)" />
  <alias field="cep95_m" index="5" name="CEP95 (m)" />
 </aliases>
 <editable>
  <field name="fid" editable="0" />
  <field name="estimate_id" editable="0" />
  <field name="object" editable="0" />
  <field name="sigma_major_m" editable="0" />
  <field name="sigma_minor_m" editable="0" />
  <field name="cep95_m" editable="0" />
 </editable>
 <previewExpression>"object"</previewExpression>
 <mapTip enabled="1">95 % ellipse of object &lt;b&gt;[% coalesce(nullif(replace(replace("object", '&amp;', '&amp;amp;'), '&lt;', '&amp;lt;'), ''), '–') %]&lt;/b&gt;
&lt;br&gt;σ [% coalesce(to_string(round("sigma_major_m", 2)) || ' m', '–') %] × [% coalesce(to_string(round("sigma_minor_m", 2)) || ' m', '–') %], CEP95 [% coalesce(to_string(round("cep95_m", 2)) || ' m', '–') %]</mapTip>
</qgis>
